"""What of a model a recording does not tell: joints that it lacks are held, and a base that would fall is."""

import copy
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import HELD, WIDEST_PLAY, goal_joints, pad_joints
from nas_data.mjcf.unique_name import free_name
from nas_data.simulators.controls import UntoldControl, length_control, length_feedback
from nas_data.simulators.layout import Layout

RIGID = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # impedance, the engine's largest
STILL = 1e-6  # [rad] or [m] off its reference to which a servo without a command may go
GENERIC = 0.05  # [rad] or [m] off the reference, where no lever happens to be zero
INDEPENDENT = 1e-6  # singular value from which directions count as different


def hold_others(
    spec: mujoco.MjSpec, joints: Sequence[str], name: str = "the model", commanded: bool = False
) -> tuple[str, ...]:
    """Hold the joints that neither the recording nor anything in the model moves or holds; return their names.

    Left as they are: objects, position servos that keep the reference, joints with springs or with play, and
    those that a constraint makes follow others (a gripper's second finger, a linkage). Held is what these and the
    measured joints together leave undetermined.

    Args:
        spec: Model; it is given a constraint for each joint that is held.
        joints: Measured joints.
        name: What to call the model in an error.
        commanded: Whether servos are commanded their reference; else, as in a file, all controls are zero.
    """
    model = spec.copy().compile()
    layout = Layout.of(model, joints, name)
    still, driven = steady(model, layout), actuated_joints(model)
    loose = sorted(set(movable(model)) - still, key=lambda joint: (joint not in driven, joint))
    dofs = model.jnt_dofadr[loose]
    known = [row[dofs] for row in (*followers(model), *servos(model, commanded), *tendon_springs(model))]
    names = []
    for joint, row in zip(loose, np.eye(len(loose)), strict=True):
        if rank([*known, row]) > rank(known):
            known.append(row)
            names.append(hold(spec, spec.joints[joint]))
    return tuple(names)


def lacks_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> bool:
    """Whether a model has hinges or slides that are not measured."""
    moving = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return any(joint.type in moving and joint.name not in joints for joint in spec.joints)


def refuse_standing(model: mujoco.MjModel, layout: Layout, positions: np.ndarray, name: str) -> None:
    """Refuse a robot whose base is held although what its measured joints move stands on something.

    Args:
        model: Compiled model, its base fastened to the world.
        layout: Its measured joints.
        positions: Of the joints, shape (N, n).
        name: What to call the model in the error.

    Raises:
        ModelFileError: names what touches what.
    """
    data = mujoco.MjData(model)
    moved = [any(model.dof_bodyid[dof] in above(model, body) for dof in layout.dof) for body in range(model.nbody)]
    for row in positions:
        data.qpos[layout.qpos] = row
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            bodies = model.geom_bodyid[contact.geom]
            if contact.dist < 0 and (model.body_weldid[bodies] == 0).any() and any(moved[body] for body in bodies):
                foot = next(int(body) for body in bodies if moved[body])
                raise ModelFileError(
                    f"{name} stands on the ground with its '{model.body(foot).name}', so that its base moves, and no "
                    "joint tells how: it can be simulated only where it hangs in the air or its base is fixed; take "
                    "the ground out of the model, or raise the base, if that is how it was recorded."
                )


def above(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and those that carry it."""
    found = {body}
    while body:
        found.add(body := int(model.body_parentid[body]))
    return found


def hold(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> str:
    """Add a constraint that keeps a joint at its reference; return the joint's name, which it may lack."""
    joint.name = joint.name or free_name(spec.joint, "joint")
    equality = spec.add_equality(name=free_name(spec.equality, joint.name + HELD))
    equality.type, equality.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    equality.name1, equality.active, equality.data = joint.name, True, np.zeros(len(equality.data))
    equality.solref, equality.solimp = [2 * spec.option.timestep, 1.0], RIGID
    return str(joint.name)


def rank(rows: list[np.ndarray]) -> int:
    """Return how many independent directions rows have, each taken as one of length 1."""
    lengths = [float(np.linalg.norm(row)) for row in rows]
    units = [row / length for row, length in zip(rows, lengths, strict=True) if length > INDEPENDENT]
    return int(np.linalg.matrix_rank(np.array(units), tol=INDEPENDENT)) if units else 0


def movable(model: mujoco.MjModel) -> list[int]:
    """Return the hinges and slides, which a constraint can hold."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def steady(model: mujoco.MjModel, layout: Layout) -> set[int]:
    """Return the joints that are measured, an object's, a servo's part, on a spring, in a play, or neither of both."""
    addresses = [*np.flatnonzero(layout.position_map.any(axis=0)), *layout.qpos, *layout.objects.qpos]
    found = {joint for joint in range(model.njnt) if model.jnt_qposadr[joint] in addresses}
    found |= set(goal_joints(model)) | set(pad_joints(model))
    found |= set(range(model.njnt)) - set(movable(model))
    found |= {joint for joint in range(model.njnt) if np.any(model.jnt_stiffness[joint] > 0)}
    return found | {joint for joint in set(movable(model)) - actuated_joints(model) if is_play(model, joint)}


def is_play(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a joint is a hinge that can hardly turn."""
    hinge = int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    turned = np.abs(model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]).max()
    return bool(hinge and model.jnt_limited[joint] and turned <= WIDEST_PLAY)


def actuated_joints(model: mujoco.MjModel) -> set[int]:
    """Return the joints on which an actuator acts."""
    acting = np.array([row for _, row in moments(model)]).reshape(-1, model.nv)
    return {int(model.dof_jntid[dof]) for dof in np.flatnonzero(acting.any(axis=0))}


def servos(model: mujoco.MjModel, commanded: bool) -> Iterator[np.ndarray]:
    """Yield the moments (nv,) of the position servos; of those that a zero command keeps at the reference, if not."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for actuator, row in moments(model):
        feedback = length_feedback(model, actuator)
        force = float(data.actuator_force[model.actuator_outadr[actuator]])
        if holds_position(model, actuator) and (commanded or abs(force) <= STILL * feedback):
            yield row


def holds_position(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator is a position servo."""
    try:
        return bool(model.actuator_ctrlnum[actuator]) and length_control(model, actuator).kind == POSITION
    except UntoldControl:
        return False


def moments(model: mujoco.MjModel) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each actuator and its moment about the degrees of freedom, shape (nv,), away from singular postures."""
    data = generic_posture(model)
    for actuator in range(model.nactuator):
        output, row = int(model.actuator_outadr[actuator]), np.zeros(model.nv)
        part = slice(data.moment_rowadr[output], data.moment_rowadr[output] + data.moment_rownnz[output])
        row[data.moment_colind[part]] = data.actuator_moment[part]
        yield actuator, row


def followers(model: mujoco.MjModel) -> list[np.ndarray]:
    """Return the directions (nv,) that active equality constraints rule out."""
    data = generic_posture(model)
    rows = data.efc_J.reshape(-1, model.nv)[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
    return [row.copy() for row in rows if row.any()]


def tendon_springs(model: mujoco.MjModel) -> Iterator[np.ndarray]:
    """Yield how each tendon that is a spring turns the joints, shape (nv,)."""
    data = generic_posture(model)
    for tendon in range(model.ntendon):
        part = slice(model.ten_J_rowadr[tendon], model.ten_J_rowadr[tendon] + model.ten_J_rownnz[tendon])
        if np.any(model.tendon_stiffness[tendon] > 0):
            row = np.zeros(model.nv)
            row[model.ten_J_colind[part]] = data.ten_J[part]
            yield row


def generic_posture(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the model a little off its reference, with dense Jacobians."""
    dense = copy.copy(model)
    dense.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(dense)
    places = model.jnt_qposadr[movable(model)]
    data.qpos[places] += GENERIC * np.random.default_rng(0).normal(size=len(places))
    mujoco.mj_forward(dense, data)
    return data
