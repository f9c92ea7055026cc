"""Drives of a joint other than its commanded actuator: tendons, sites, bodies, second servos and constraints."""

from collections.abc import Collection

import mujoco
import numpy as np

from nas_data.log import warn_once
from nas_data.mjcf.actuator_lookup import SHARED, describe_transmission, is_switched_off
from nas_data.simulators.followers import list_tied_dofs, make_generic_posture

LEVER = 1e-9  # smallest moment arm that counts
FORCES = (int(mujoco.mjtBias.mjBIAS_MUSCLE), int(mujoco.mjtBias.mjBIAS_USER))  # passive forces of unknown form
SPRINGS = (int(mujoco.mjtGain.mjGAIN_PID), int(mujoco.mjtGain.mjGAIN_DCMOTOR))
PROPORTIONAL = 4  # index of a controller's proportional gain in `gainprm` of a dcmotor


def explain_missing_actuator(model: mujoco.MjModel, joint: int, name: str) -> str:
    """Return the error message, with a remedy, for a joint without an actuator of its own.

    Args:
        model: Compiled model.
        joint: Index of the joint.
        name: Name of the model.
    """
    own, leader = model.joint(joint).name, find_leader(model, joint)
    for actuator in find_reaching_actuators(model, [int(model.jnt_dofadr[joint])]):
        through, driven = describe_transmission(model, actuator), find_shared_joint(model, actuator)
        if driven is not None and driven != own:
            return (
                f"'{own}' of {name} moves together with '{driven}', whose commands drive both; leave it out of "
                "'joints' of the map and import again."
            )
        if through is not None:
            return (
                f"'{own}' of {name} is moved through {through} by the actuator{_quote(model, actuator)}, but only an "
                f'actuator of the joint itself takes its commands; replace it by <position joint="{own}" kp="…"/>.'
            )
    if leader is not None:
        return (
            f"'{own}' of {name} follows {leader} (an equality or mimic of the model) and takes no commands; leave it "
            "out of 'joints' of the map and import again."
        )
    return f'No actuator of {name} drives the joint \'{own}\'; add one, for example <position joint="…" kp="…"/>.'


def find_leader(model: mujoco.MjModel, joint: int) -> str | None:
    """Return the quoted name of the joint that a joint follows by an active equality; None if it follows none.

    If a tendon or closed loop ties it to several actuated joints, all are named.
    """
    if (leader := _find_joint_leader(model, joint)) is not None:
        return f"'{model.joint(leader).name}'"
    tied = list_tied_dofs(model, int(model.jnt_dofadr[joint]))
    driven = sorted({dof for moved in find_reaching_actuators(model, tied).values() for dof in moved})
    return ", ".join(f"'{model.joint(int(model.dof_jntid[dof])).name}'" for dof in driven) or None


def _find_joint_leader(model: mujoco.MjModel, joint: int) -> int | None:
    """Return the second joint of an active equality between two joints whose first joint is given."""
    between = (model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0 & (model.eq_obj2id >= 0)
    found = model.eq_obj2id[between & (model.eq_obj1id == joint)]
    return int(found[0]) if len(found) else None


def find_shared_joint(model: mujoco.MjModel, actuator: int) -> str | None:
    """Return the joint whose commands an actuator of several coupled joints takes; None for other actuators."""
    if model.actuator_trntype[actuator] != int(mujoco.mjtTrn.mjTRN_TENDON):
        return None
    tendon = str(model.tendon(int(model.actuator_trnid[actuator, 0])).name)
    return tendon.removesuffix(SHARED) if tendon.endswith(SHARED) else None


def warn_of_held_actuators(
    model: mujoco.MjModel, joints: Collection[int], commanded: Collection[int], name: str
) -> None:
    """Warn once of each uncommanded actuator that pulls a commanded joint to its reference.

    Actuators without a force at rest, such as motors and dampers, are harmless.

    Args:
        model: Compiled model.
        joints: Indices of the commanded joints.
        commanded: Indices of the commanded actuators.
        name: Name of the model.
    """
    if set(np.flatnonzero(model.actuator_ctrlnum > 0).tolist()) <= set(commanded):
        return
    coupled = {*joints, *(joint for joint in range(model.njnt) if _find_joint_leader(model, joint) in joints)}
    dofs = [int(model.jnt_dofadr[joint]) for joint in coupled]
    for actuator, moved in find_reaching_actuators(model, dofs).items():
        if actuator in commanded or is_switched_off(model, actuator) or not pulls(model, actuator):
            continue
        joint = model.joint(int(model.dof_jntid[moved[0]])).name
        through = f" through {words}" if (words := describe_transmission(model, actuator)) else ""
        warn_once(
            f"the actuator{_quote(model, actuator)} of {name} pulls '{joint}'{through} and gets no command: it stays "
            "at its reference and works against the joint's own actuator; remove it from the model if the robot does "
            "not have both."
        )


def pulls(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator has a length-dependent force at zero control."""
    gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
    if gain in SPRINGS:
        return bool(model.actuator_gainprm[actuator, PROPORTIONAL] or model.actuator_biasprm[actuator, 1])
    return bias in FORCES or (bias == int(mujoco.mjtBias.mjBIAS_AFFINE) and bool(model.actuator_biasprm[actuator, 1]))


def find_reaching_actuators(model: mujoco.MjModel, dofs: Collection[int]) -> dict[int, list[int]]:
    """Return the actuators with control that move given degrees of freedom, and which they move.

    Args:
        model: Compiled model.
        dofs: Indices in `qvel`.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = make_generic_posture(model)
    mujoco.mj_fwdPosition(model, data)
    found = {}
    for actuator in np.flatnonzero(model.actuator_ctrlnum > 0).tolist():
        output = int(model.actuator_outadr[actuator])
        chosen = slice(data.moment_rowadr[output], data.moment_rowadr[output] + data.moment_rownnz[output])
        moved = data.moment_colind[chosen][np.abs(data.actuator_moment[chosen]) > LEVER].tolist()
        if reached := [dof for dof in moved if dof in dofs]:
            found[actuator] = reached
    return found


def _quote(model: mujoco.MjModel, actuator: int) -> str:
    """Return an actuator's name in quotes after a space; empty if it has none."""
    own = model.actuator(actuator).name
    return f" '{own}'" if own else ""
