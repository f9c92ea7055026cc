"""The position servo of a joint in an editable model."""

import math
from collections.abc import Iterable

import mujoco
import numpy as np

from nas_data.effects.base import joint_actuator
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import BAND, DAMPING, GAIN, GOAL, PARTS, REST_SHIFT, driven_joint

ALIKE = 1e-6  # relative difference below which a gain is an actuator's own feedback


def position_servo(spec: mujoco.MjSpec, joint: str, effect: str) -> mujoco.MjsActuator:
    """Return the actuator of a joint that holds a commanded position.

    Args:
        spec: Model.
        joint: Joint's name.
        effect: Who asks, for the error.

    Raises:
        JointMismatch: nothing drives the joint.
        ModelFileError: what drives it takes torques.
    """
    actuator = joint_actuator(spec, joint)
    if feedback(actuator) <= 0 or not takes_position(actuator):
        raise ModelFileError(
            f"{effect} acts on a position servo; the actuator '{actuator.name}' of the joint '{joint}' has no "
            "position feedback: give a model whose actuators are <position> or <pid>."
        )
    return actuator


def takes_position(actuator: mujoco.MjsActuator) -> bool:
    """Whether the control of an actuator with position feedback is a position, not the speed of its setpoint."""
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_PID and actuator.ctrlspec:
        return bool(actuator.ctrlspec & int(mujoco.mjtCtrlInput.mjINPUT_POS))
    return bool(actuator.dyntype != mujoco.mjtDyn.mjDYN_INTEGRATOR)


def takes_velocity(actuator: mujoco.MjsActuator) -> bool:
    """Whether the control of an actuator without position feedback is a speed: said so, or its gain is its feedback."""
    gain, feedback_of_speed = float(actuator.gainprm[0]), -float(actuator.biasprm[2])
    said = actuator.ctrlspec > 0 and bool(actuator.ctrlspec & int(mujoco.mjtCtrlInput.mjINPUT_VEL))
    return said or math.isclose(gain, feedback_of_speed, rel_tol=ALIKE)


def take_own_unit(spec: mujoco.MjSpec, joint: str, actuator: mujoco.MjsActuator) -> None:
    """Write a servo whose control has its own unit (gain k, feedback f) as one with another gear and no such unit.

    With the gear times f / k, forces are times k / f, and length and speed times f / k: the joint feels the same. Where
    the unit begins stays in the constant force, and the model's number tells it from an offset (see `rest_shift`).
    """
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.gainprm[0] == feedback(actuator):
        return
    factor = feedback(actuator) / float(actuator.gainprm[0])
    number = shift_number(spec, joint)
    number.data = [number.data[0] / factor]
    gear, gain, bias = actuator.gear.copy(), actuator.gainprm.copy(), actuator.biasprm.copy()
    gear[0] *= factor
    bias[:3] /= [factor, factor**2, factor**2]
    gain[0] = -bias[1]
    actuator.gear, actuator.gainprm, actuator.biasprm = gear, gain, bias
    actuator.forcerange = np.sort(actuator.forcerange / factor)
    actuator.armature, actuator.damping = actuator.armature / factor**2, actuator.damping / factor**2


def feedback(actuator: mujoco.MjsActuator) -> float:
    """Return an actuator's force per position error; 0 for one without position feedback."""
    return -float(actuator.biasprm[1])


def stiffness(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the torque that a joint's servo gives per position error [N·m/rad]; 0 without position feedback."""
    actuator = part(spec, joint, GAIN)
    return feedback(actuator) * float(actuator.gear[0]) ** 2


def damping(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the torque that a joint's servo gives against its speed [N·m·s/rad]; negative for a damping ratio."""
    actuator = part(spec, joint, DAMPING)
    return -float(actuator.biasprm[2]) * float(actuator.gear[0]) ** 2


def scale_stiffness(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply a servo's position gain; damping and dead band stay, and so does the angle at which it rests."""
    multiply_servo(spec, joint, joint_actuator(spec, joint), factor)
    for name in PARTS:
        if (other := spec.actuator(joint + name)) is not None:
            multiply_feedback(other, factor)
    if (band := spec.actuator(joint + BAND)) is not None:
        band.forcerange = band.forcerange * factor
        goal = spec.joint(joint + GOAL)
        goal.damping, goal.armature = goal.damping * factor, goal.armature * factor


def scale_damping(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply a servo's velocity feedback, which ends where the servo saturates and the joint's damping does not.

    The gain of a servo that is asked for a speed goes with it, so that it is asked for the same speed as before.
    """
    actuator = part(spec, joint, DAMPING)
    bias = actuator.biasprm.copy()
    asks_for_speed = not bias[1] and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and takes_velocity(actuator)
    bias[2] *= factor
    actuator.biasprm = bias
    if asks_for_speed:
        gain = actuator.gainprm.copy()
        gain[0] *= factor
        actuator.gainprm = gain


def filter_time(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the time constant of the filter that a joint's actuator has on its command [s]; 0 where it has none."""
    actuator = joint_actuator(spec, joint)
    filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    return float(actuator.dynprm[0]) if actuator.dyntype in filters else 0.0


def scale_filter(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply the time constant of an actuator's filter, which is integrated exactly from then on.

    An explicit step of a filter faster than two timesteps would diverge.
    """
    actuator = joint_actuator(spec, joint)
    parameters = actuator.dynprm.copy()
    parameters[0] *= factor
    actuator.dyntype, actuator.dynprm = mujoco.mjtDyn.mjDYN_FILTEREXACT, parameters


def torque_limit(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the largest torque that a joint's servo gives [N·m], its own limit or the joint's; infinite without."""
    actuator, element = joint_actuator(spec, joint), spec.joint(joint)
    own = torque_limits(actuator)
    found = [max(map(abs, own)) * abs(float(actuator.gear[0]))] if own else []
    if element.actfrclimited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(element.actfrcrange):
        found.append(float(np.abs(element.actfrcrange).max()))
    return min(found, default=np.inf)


def scale_limit(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply the largest torque that a joint's servo gives, its own limit and the joint's."""
    actuator, element = joint_actuator(spec, joint), spec.joint(joint)
    actuator.forcerange = actuator.forcerange * factor
    element.actfrcrange = element.actfrcrange * factor


def multiply_servo(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, factor: float) -> None:
    """Multiply the force per position error of a joint's servo; where it rests, and where its unit begins, stays."""
    multiply_feedback(servo, factor)
    if (number := spec.numeric(joint + REST_SHIFT)) is not None:
        number.data = [number.data[0] * factor]


def multiply_feedback(actuator: mujoco.MjsActuator, factor: float) -> None:
    """Multiply an actuator's force per position error."""
    bias = actuator.biasprm.copy()
    bias[:2] *= factor
    actuator.biasprm = bias
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED:
        gain = actuator.gainprm.copy()
        gain[0] *= factor
        actuator.gainprm = gain


def part(spec: mujoco.MjSpec, joint: str, name: str) -> mujoco.MjsActuator:
    """Return a part of a servo with a dead band, or the whole servo where it has none."""
    if spec.actuator(joint + BAND) is None:
        return joint_actuator(spec, joint)
    return spec.actuator(joint + name)


def shift_rest(spec: mujoco.MjSpec, joint: str, actuator: mujoco.MjsActuator, offset: float) -> None:
    """Let a servo come to rest at its command plus an offset of the joint [rad].

    Where the gain is not the feedback, a constant force may be where the control's own unit begins, so that the model
    is given a number that tells both apart (see `rest_shift`).
    """
    bias, force = actuator.biasprm.copy(), feedback(actuator) * float(actuator.gear[0]) * offset
    bias[0] += force
    actuator.biasprm = bias
    own_unit = actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and actuator.gainprm[0] != feedback(actuator)
    if own_unit or spec.numeric(joint + REST_SHIFT) is not None:
        number = shift_number(spec, joint)
        number.data = [number.data[0] + force]


def shift_number(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsNumeric:
    """Return the number of a model that says what of the constant force of a joint's servo is an effect's."""
    return spec.numeric(joint + REST_SHIFT) or spec.add_numeric(name=joint + REST_SHIFT, size=1, data=[0.0])


def rest_shift(model: mujoco.MjModel, joint: str) -> float | None:
    """Return what of the constant force of a joint's servo is an effect's, as `shift_rest` says [N·m over the gear].

    The rest is where the control's own unit begins. Without such a number, None, an effect added nothing, and the
    control of a <pid> has no zero of its own.
    """
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, joint + REST_SHIFT)
    return None if number < 0 else float(model.numeric_data[model.numeric_adr[number]])


def torque_limits(actuator: mujoco.MjsActuator) -> tuple[float, float] | None:
    """Return the lowest and highest force of an actuator, None where it has no limits."""
    limited = actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(np.any(actuator.forcerange))
    )
    return (float(actuator.forcerange[0]), float(actuator.forcerange[1])) if limited else None


def limit_torque(joint: mujoco.MjsJoint, low: float, high: float) -> None:
    """Bound what all actuators together give a joint [N·m]; narrower bounds that it has already stay."""
    if joint.actfrclimited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(joint.actfrcrange):
        low, high = max(low, joint.actfrcrange[0]), min(high, joint.actfrcrange[1])
    joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]


def actuators_of(spec: mujoco.MjSpec, joint: str | None) -> Iterable[mujoco.MjsActuator]:
    """Return the actuator of one joint, or all that drive a joint where it is None."""
    if joint is not None:
        return [joint_actuator(spec, joint)]
    return [actuator for actuator in spec.actuators if driven_joint(spec, actuator) is not None]
