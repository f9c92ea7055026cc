"""Constraints that lock the joints of a model whose motion a recording does not determine."""

import copy
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import HELD, WIDEST_PLAY, find_goal_joints, find_pad_joints
from nas_data.mjcf.unique_name import make_unique_name
from nas_data.simulators.controls import UnknownControl, find_length_control, read_length_feedback
from nas_data.simulators.layout import Layout

RIGID = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp with MuJoCo's largest impedance
REFERENCE_TOLERANCE = 1e-6  # [rad] or [m] largest deviation from the reference of a servo with control zero
PERTURBATION = 0.05  # [rad] or [m] distance from the reference posture, where moment arms may vanish by chance
INDEPENDENT = 1e-6  # smallest singular value of independent directions


def lock_unmeasured_joints(
    spec: mujoco.MjSpec, joints: Sequence[str], name: str = "the model", commanded: bool = False
) -> tuple[str, ...]:
    """Lock the joints that neither the recording nor the model determines; return their names.

    Not locked are objects, position servos that hold the reference, joints with springs or play, and followers of
    other joints (a gripper's second finger, a linkage). Joints that all these leave undetermined are locked.

    Args:
        spec: Model; an equality constraint is added for each locked joint.
        joints: Measured joints.
        name: Name of the model in errors.
        commanded: Whether servos are commanded their reference; if not, all controls are zero.
    """
    model = spec.copy().compile()
    layout = Layout.of(model, joints, name)
    exempt, driven = find_exempt_joints(model, layout), find_actuated(model)
    loose = sorted(set(find_scalar_joints(model)) - exempt, key=lambda joint: (joint not in driven, joint))
    dofs = model.jnt_dofadr[loose]
    constraints = (
        *compute_equality_jacobian(model),
        *compute_servo_moments(model, commanded),
        *compute_tendon_spring_moments(model),
    )
    known = [row[dofs] for row in constraints]
    names = []
    for joint, row in zip(loose, np.eye(len(loose)), strict=True):
        if rank([*known, row]) > rank(known):
            known.append(row)
            names.append(lock(spec, spec.joints[joint]))
    return tuple(names)


def has_unmeasured_joints(spec: mujoco.MjSpec, joints: Sequence[str]) -> bool:
    """Whether a model has hinges or slides that are not measured."""
    moving = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return any(joint.type in moving and joint.name not in joints for joint in spec.joints)


def refuse_ground_contact(model: mujoco.MjModel, layout: Layout, positions: np.ndarray, name: str) -> None:
    """Refuse a robot with a fixed base if a link that its measured joints move stands on the ground.

    Args:
        model: Compiled model with its base fixed to the world.
        layout: Its measured joints.
        positions: Joint positions [rad; m], shape (N, n).
        name: Name of the model in errors.

    Raises:
        ModelFileError: names the body that touches the ground.
    """
    data = mujoco.MjData(model)
    ancestors = [find_ancestors(model, body) for body in range(model.nbody)]
    moved = np.array([any(model.dof_bodyid[dof] in above for dof in layout.dof) for above in ancestors])
    # the robot's own base is fixed to the world, too, but a leg that touches it does not move it
    carrying = set().union(*(ancestors[body] for body in model.dof_bodyid[layout.dof])) - {0}
    ground = np.array([model.body_weldid[body] == 0 and not above & carrying for body, above in enumerate(ancestors)])
    for row in positions:
        data.qpos[layout.qpos] = row
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            bodies = model.geom_bodyid[contact.geom]
            if contact.dist < 0 and ground[bodies].any() and moved[bodies].any():
                foot = next(int(body) for body in bodies if moved[body])
                raise ModelFileError(
                    f"{name} stands on the ground with its '{model.body(foot).name}', so its base can move, and the "
                    "recording does not give its pose. Only a fixed or hanging base can be simulated: if it was "
                    "recorded so, remove the ground from the model, or raise the base."
                )


def find_ancestors(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and its ancestors in the kinematic tree."""
    found = {body}
    while body:
        found.add(body := int(model.body_parentid[body]))
    return found


def lock(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> str:
    """Add a constraint that keeps a joint at its reference; return its name, which is generated if it has none."""
    joint.name = joint.name or make_unique_name(spec.joint, "joint")
    equality = spec.add_equality(name=make_unique_name(spec.equality, joint.name + HELD))
    equality.type, equality.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    equality.name1, equality.active, equality.data = joint.name, True, np.zeros(len(equality.data))
    equality.solref, equality.solimp = [2 * spec.option.timestep, 1.0], RIGID
    return str(joint.name)


def rank(rows: list[np.ndarray]) -> int:
    """Return the rank of rows (nv,) after each is normalised to length 1."""
    lengths = [float(np.linalg.norm(row)) for row in rows]
    units = [row / length for row, length in zip(rows, lengths, strict=True) if length > INDEPENDENT]
    return int(np.linalg.matrix_rank(np.array(units), tol=INDEPENDENT)) if units else 0


def find_scalar_joints(model: mujoco.MjModel) -> list[int]:
    """Return the hinges and slides; only these can be locked by a joint constraint."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def find_exempt_joints(model: mujoco.MjModel, layout: Layout) -> set[int]:
    """Return the joints that need no lock.

    These are measured joints, objects, auxiliary joints of servos, joints with a spring or play, and ball and free
    joints.
    """
    addresses = [*np.flatnonzero(layout.position_map.any(axis=0)), *layout.qpos, *layout.objects.qpos]
    found = {joint for joint in range(model.njnt) if model.jnt_qposadr[joint] in addresses}
    found |= set(find_goal_joints(model)) | set(find_pad_joints(model))
    found |= set(range(model.njnt)) - set(find_scalar_joints(model))
    found |= {joint for joint in range(model.njnt) if np.any(model.jnt_stiffness[joint] > 0)}
    return found | {joint for joint in set(find_scalar_joints(model)) - find_actuated(model) if is_play(model, joint)}


def is_play(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a joint is a hinge whose range is as narrow as free play."""
    hinge = int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    turned = np.abs(model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]).max()
    return bool(hinge and model.jnt_limited[joint] and turned <= WIDEST_PLAY)


def find_actuated(model: mujoco.MjModel) -> set[int]:
    """Return the joints on which an actuator acts."""
    acting = np.array([row for _, row in compute_actuator_moments(model)]).reshape(-1, model.nv)
    return {int(model.dof_jntid[dof]) for dof in np.flatnonzero(acting.any(axis=0))}


def compute_servo_moments(model: mujoco.MjModel, commanded: bool) -> Iterator[np.ndarray]:
    """Yield the moments (nv,) of position servos: of all if commanded, else of those that control zero holds still."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for actuator, row in compute_actuator_moments(model):
        feedback = read_length_feedback(model, actuator)
        force = float(data.actuator_force[model.actuator_outadr[actuator]])
        if is_position_servo(model, actuator) and (commanded or abs(force) <= REFERENCE_TOLERANCE * feedback):
            yield row


def is_position_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator is a position servo."""
    try:
        return bool(model.actuator_ctrlnum[actuator]) and find_length_control(model, actuator).kind == POSITION
    except UnknownControl:
        return False


def compute_actuator_moments(model: mujoco.MjModel) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each actuator and its moment arms, shape (nv,), in a posture that is not singular."""
    data = make_generic_data(model)
    for actuator in range(model.nactuator):
        output, row = int(model.actuator_outadr[actuator]), np.zeros(model.nv)
        part = slice(data.moment_rowadr[output], data.moment_rowadr[output] + data.moment_rownnz[output])
        row[data.moment_colind[part]] = data.actuator_moment[part]
        yield actuator, row


def compute_equality_jacobian(model: mujoco.MjModel) -> list[np.ndarray]:
    """Return the Jacobian rows (nv,) of active equality constraints."""
    data = make_generic_data(model)
    rows = data.efc_J.reshape(-1, model.nv)[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
    return [row.copy() for row in rows if row.any()]


def compute_tendon_spring_moments(model: mujoco.MjModel) -> Iterator[np.ndarray]:
    """Yield the moment arms (nv,) of each tendon with stiffness."""
    data = make_generic_data(model)
    for tendon in range(model.ntendon):
        part = slice(model.ten_J_rowadr[tendon], model.ten_J_rowadr[tendon] + model.ten_J_rownnz[tendon])
        if np.any(model.tendon_stiffness[tendon] > 0):
            row = np.zeros(model.nv)
            row[model.ten_J_colind[part]] = data.ten_J[part]
            yield row


def make_generic_data(model: mujoco.MjModel) -> mujoco.MjData:
    """Return data near the reference posture, computed with dense Jacobians."""
    dense = copy.copy(model)
    dense.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(dense)
    addresses = model.jnt_qposadr[find_scalar_joints(model)]
    data.qpos[addresses] += PERTURBATION * np.random.default_rng(0).normal(size=len(addresses))
    mujoco.mj_forward(dense, data)
    return data
