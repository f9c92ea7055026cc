"""Gains, limits and offsets of servos in an `MjSpec`."""

import math
from collections.abc import Iterable

import mujoco
import numpy as np

from nas_data.effects.base import find_joint_actuator
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import (
    BAND,
    CURVE,
    DAMPING,
    GOAL,
    GOAL_GAIN,
    PROFILE,
    REST_SHIFT,
    START,
    START_BAND,
    TRANSMISSIONS,
    find_driven_joint,
)

POSITION_INPUT = 1  # the first input of a <pid>, its position setpoint, and no other
CONTROLLER_DAMPING = 6  # index of the derivative gain of a dcmotor's controller in `gainprm`
GAIN_TOLERANCE = 1e-6  # relative tolerance within which a gain equals the feedback


def find_position_servo(
    spec: mujoco.MjSpec, joint: str, effect: str, may_integrate: bool = False
) -> mujoco.MjsActuator:
    """Return the position servo of a joint.

    Args:
        spec: Model.
        joint: Name of the joint.
        effect: Name of the effect, for the error.
        may_integrate: Whether a servo whose setpoint integrates a velocity command is one, too.

    Raises:
        JointMismatch: no actuator drives the joint.
        ModelFileError: its actuator has no position feedback, or is commanded something else.
    """
    actuator = find_joint_actuator(spec, joint)
    if read_position_feedback(actuator) <= 0 or not (may_integrate or is_position_controlled(actuator)):
        kinds = "<position>, <pid> or <intvelocity>" if may_integrate else "<position> or <pid>"
        raise ModelFileError(
            f"{effect} needs a position servo, but the actuator '{actuator.name}' of the joint '{joint}' is not one: "
            f"give a model whose actuators are {kinds}."
        )
    return actuator


def find_speed_servo(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsActuator | None:
    """Return the actuator of a joint that is commanded a speed; None if it is commanded anything else."""
    actuator = find_joint_actuator(spec, joint)
    if read_position_feedback(actuator) > 0:
        return None if is_position_controlled(actuator) else actuator
    return actuator if is_velocity_controlled(actuator) else None


def is_velocity_servo(spec: mujoco.MjSpec, joint: str) -> bool:
    """Whether a joint's actuator has velocity feedback only, and is commanded a speed."""
    servo = find_speed_servo(spec, joint)
    return servo is not None and read_position_feedback(servo) <= 0 and read_servo_damping(spec, joint) > 0


def is_position_controlled(actuator: mujoco.MjsActuator) -> bool:
    """Whether the control of an actuator with position feedback is a position, and not the speed of its setpoint."""
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_PID and actuator.ctrlspec:
        return bool(actuator.ctrlspec & int(mujoco.mjtCtrlInput.mjINPUT_POS))
    return bool(actuator.dyntype != mujoco.mjtDyn.mjDYN_INTEGRATOR)


def is_velocity_controlled(actuator: mujoco.MjsActuator) -> bool:
    """Whether the control of an actuator without position feedback is a speed, by its `ctrlspec` or its gains."""
    gain, velocity_feedback = float(actuator.gainprm[0]), -float(actuator.biasprm[2])
    declared = actuator.ctrlspec > 0 and bool(actuator.ctrlspec & int(mujoco.mjtCtrlInput.mjINPUT_VEL))
    return declared or (gain != 0 and math.isclose(gain, velocity_feedback, rel_tol=GAIN_TOLERANCE))


def compute_control_per_speed(actuator: mujoco.MjsActuator) -> float:
    """Return the control of an actuator that is commanded a speed, per speed of its joint [s/rad · unit of control]."""
    gain, gear = float(actuator.gainprm[0]), float(actuator.gear[0])
    if actuator.gaintype in (mujoco.mjtGain.mjGAIN_PID, mujoco.mjtGain.mjGAIN_DCMOTOR):
        return gear
    return gear * (read_position_feedback(actuator) or -float(actuator.biasprm[2])) / gain


def take_own_unit(spec: mujoco.MjSpec, joint: str, actuator: mujoco.MjsActuator) -> None:
    """Convert a servo whose control has its own unit (gain k, feedback f) to an equivalent one with another gear.

    With the gear multiplied by f / k, forces are multiplied by k / f, and lengths and speeds by f / k; the joint torque
    is unchanged. The zero of the unit stays in the constant force; `read_rest_shift` separates it from an offset.
    """
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.gainprm[0] == read_position_feedback(actuator):
        return
    factor = read_position_feedback(actuator) / float(actuator.gainprm[0])
    number = ensure_shift_numeric(spec, joint)
    number.data = [number.data[0] / factor]
    gear, gain, bias = actuator.gear.copy(), actuator.gainprm.copy(), actuator.biasprm.copy()
    gear[0] *= factor
    bias[:3] /= [factor, factor**2, factor**2]
    gain[0] = -bias[1]
    actuator.gear, actuator.gainprm, actuator.biasprm = gear, gain, bias
    actuator.forcerange = np.sort(actuator.forcerange / factor)
    actuator.armature, actuator.damping = actuator.armature / factor**2, actuator.damping / factor**2


def read_position_feedback(actuator: mujoco.MjsActuator) -> float:
    """Return an actuator's force per position error; 0 without position feedback."""
    return -float(actuator.biasprm[1])


def read_servo_stiffness(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the torque of a joint's servo per position error [N·m/rad]; 0 without position feedback."""
    actuator = find_part(spec, joint, GOAL_GAIN)
    assert actuator is not None
    return read_position_feedback(actuator) * float(actuator.gear[0]) ** 2


def read_servo_damping(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the velocity feedback of a joint's servo [N·m·s/rad]; negative for a damping ratio.

    It is the gain of a velocity servo.
    """
    if (actuator := find_part(spec, joint, DAMPING)) is None:
        return 0.0
    own = actuator.gainprm[CONTROLLER_DAMPING] if has_controller(actuator) else -actuator.biasprm[2]
    return float(own) * float(actuator.gear[0]) ** 2


def has_controller(actuator: mujoco.MjsActuator) -> bool:
    """Whether an actuator is a dcmotor with a controller, whose gains are not in `biasprm`."""
    commanded = actuator.ctrlspec != int(mujoco.mjtCtrlInput.mjINPUT_NONE)
    return bool(actuator.gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR and commanded)


def scale_stiffness(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply a servo's position gain; damping, dead band, start torque, profile and rest position stay."""
    has_profile = spec.actuator(joint + PROFILE) is not None
    if not has_profile:  # with a profile, the servo only moves its goal
        multiply_servo(spec, joint, find_joint_actuator(spec, joint), factor)
    if (gain := spec.actuator(joint + GOAL_GAIN)) is None:
        return
    half_width, torque = read_band(spec, joint)
    multiply_feedback(gain, factor)
    if (band := spec.actuator(joint + BAND)) is not None:
        multiply_feedback(band, factor)
        limit_force(band, float(band.biasprm[1]) * half_width + torque)
    if not has_profile:
        goal = spec.joint(joint + GOAL)
        goal.damping, goal.armature = goal.damping * factor, goal.armature * factor


def read_band(spec: mujoco.MjSpec, joint: str) -> tuple[float, float]:
    """Return the half width of a servo's dead band [rad] and its start torque [N·m]; the servo has a goal joint."""
    if (band := spec.actuator(joint + BAND)) is None:
        return 0.0, 0.0
    starts = [spec.actuator(joint + name) for name in (START, START_BAND)]
    outer, inner = (float(each.forcerange[1]) if each is not None else 0.0 for each in starts)
    torque = outer - inner
    return (float(band.forcerange[1]) - torque) / float(band.biasprm[1]), torque


def scale_damping(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply a servo's velocity feedback; unlike the joint's damping, it is limited by saturation.

    The gain of a velocity servo is multiplied, too, so that its target speed stays.
    """
    if (actuator := find_part(spec, joint, DAMPING)) is None:
        return
    if has_controller(actuator):
        gain = actuator.gainprm.copy()
        gain[CONTROLLER_DAMPING] *= factor
        actuator.gainprm = gain
        return
    bias = actuator.biasprm.copy()
    scales_command = (
        not bias[1] and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and is_velocity_controlled(actuator)
    )
    bias[2] *= factor
    actuator.biasprm = bias
    if scales_command:
        gain = actuator.gainprm.copy()
        gain[0] *= factor
        actuator.gainprm = gain


def read_filter_time(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the time constant of the command filter of a joint's actuator [s]; 0 without a filter."""
    actuator = find_joint_actuator(spec, joint)
    filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    return float(actuator.dynprm[0]) if actuator.dyntype in filters else 0.0


def scale_filter(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply the time constant of an actuator's command filter, and switch the filter to exact integration.

    Explicit integration diverges for short time constants.
    """
    actuator = find_joint_actuator(spec, joint)
    parameters = actuator.dynprm.copy()
    parameters[0] *= factor
    actuator.dyntype, actuator.dynprm = mujoco.mjtDyn.mjDYN_FILTEREXACT, parameters


def read_torque_limit(spec: mujoco.MjSpec, joint: str) -> float:
    """Return the torque limit of a joint's servo [N·m]: the lower of actuator and joint; infinite without limits."""
    actuator, element = find_joint_actuator(spec, joint), spec.joint(joint)
    own = read_force_range(actuator)
    found = [max(map(abs, own)) * abs(float(actuator.gear[0]))] if own else []
    if has_torque_limit(element):
        found.append(float(np.abs(element.actfrcrange).max()))
    return min(found, default=np.inf)


def scale_limit(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply the torque limits of a joint's servo and of the joint."""
    actuator, element = find_joint_actuator(spec, joint), spec.joint(joint)
    actuator.forcerange = actuator.forcerange * factor
    element.actfrcrange = element.actfrcrange * factor


def multiply_servo(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, factor: float) -> None:
    """Multiply the force per position error of a joint's servo; rest position and zero of its unit stay."""
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


def find_part(spec: mujoco.MjSpec, joint: str, name: str) -> mujoco.MjsActuator | None:
    """Return an actuator of a servo with a goal joint, None if it lacks it; without one, the servo's only actuator."""
    if spec.actuator(joint + GOAL_GAIN) is None:
        return find_joint_actuator(spec, joint)
    return spec.actuator(joint + name)


def shift_rest(spec: mujoco.MjSpec, joint: str, actuator: mujoco.MjsActuator, offset: float) -> None:
    """Shift the rest position of a servo from its command by an offset of the joint [rad].

    If gain and feedback differ, a constant force also defines the zero of the control's unit. Then a custom numeric of
    the model separates both (see `read_rest_shift`).
    """
    bias, force = actuator.biasprm.copy(), read_position_feedback(actuator) * float(actuator.gear[0]) * offset
    bias[0] += force
    actuator.biasprm = bias
    own_unit = actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and actuator.gainprm[0] != read_position_feedback(
        actuator
    )
    if own_unit or spec.numeric(joint + REST_SHIFT) is not None:
        number = ensure_shift_numeric(spec, joint)
        number.data = [number.data[0] + force]


def ensure_shift_numeric(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsNumeric:
    """Return the custom numeric with the part of a servo's constant force that effects added; create it if missing."""
    return spec.numeric(joint + REST_SHIFT) or spec.add_numeric(name=joint + REST_SHIFT, size=1, data=[0.0])


def read_rest_shift(model: mujoco.MjModel, joint: str) -> float | None:
    """Return the part of a servo's constant force that `shift_rest` added [N·m divided by the gear].

    The remaining force defines the zero of the control's unit. None if effects added no force; then the control of a
    `<pid>` has no such zero.
    """
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, joint + REST_SHIFT)
    return None if number < 0 else float(model.numeric_data[model.numeric_adr[number]])


def has_own_zero(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator) -> bool:
    """Whether a constant force of a servo defines the zero of its control's own unit."""
    number = spec.numeric(joint + REST_SHIFT)
    if number is not None:  # also where `take_own_unit` converted the servo
        return not math.isclose(servo.biasprm[0], number.data[0], rel_tol=GAIN_TOLERANCE, abs_tol=GAIN_TOLERANCE)
    own_unit = servo.gaintype == mujoco.mjtGain.mjGAIN_FIXED and servo.gainprm[0] != read_position_feedback(servo)
    return bool(own_unit and servo.biasprm[0])


def read_force_range(actuator: mujoco.MjsActuator) -> tuple[float, float] | None:
    """Return the lowest and highest force of an actuator; None without limits."""
    limited = actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        actuator.forcelimited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(np.any(actuator.forcerange))
    )
    return (float(actuator.forcerange[0]), float(actuator.forcerange[1])) if limited else None


def limit_force(actuator: mujoco.MjsActuator, force: float) -> None:
    """Limit an actuator's force to ± a value."""
    actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-force, force]


def set_force_limit(actuator: mujoco.MjsActuator, torque: float) -> None:
    """Limit an actuator's force to that of a torque on its joint [N·m]."""
    limit_force(actuator, torque / abs(float(actuator.gear[0])))


def has_torque_limit(joint: mujoco.MjsJoint) -> bool:
    """Whether a joint limits the total actuator torque on it."""
    return bool(joint.actfrclimited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(joint.actfrcrange))


def set_joint_limit(joint: mujoco.MjsJoint, torque: float) -> None:
    """Set the limit of the total actuator torque on a joint [N·m]."""
    joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-torque, torque]


def limit_torque(joint: mujoco.MjsJoint, low: float, high: float) -> None:
    """Limit the total actuator torque on a joint [N·m]; narrower existing limits stay."""
    if has_torque_limit(joint):
        low, high = max(low, joint.actfrcrange[0]), min(high, joint.actfrcrange[1])
    joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]


def move_limit_to_servo(spec: mujoco.MjSpec, joint: str) -> None:
    """Limit a joint's servo in place of the joint, whose limit would include a passive actuator's friction, too.

    Nothing changes where several actuators share the joint's limit, or gravity compensation does.
    """
    element = spec.joint(joint)
    targets = [joint, *(joint + tendon for tendon in (CURVE, *TRANSMISSIONS))]
    driving = [actuator for actuator in spec.actuators if actuator.target in targets]
    if not has_torque_limit(element) or element.actgravcomp or [each.target for each in driving] != [joint]:
        return
    (servo,) = driving
    low, high = np.sort(element.actfrcrange / float(servo.gear[0]))
    own = read_force_range(servo) or (low, high)
    servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    servo.forcerange = [max(low, own[0]), min(high, own[1])]
    element.actfrclimited, element.actfrcrange = mujoco.mjtLimited.mjLIMITED_FALSE, np.zeros(2)


def find_actuators(spec: mujoco.MjSpec, joint: str | None) -> Iterable[mujoco.MjsActuator]:
    """Return the actuator of a joint; all actuators that drive joints if it is None."""
    if joint is not None:
        return [find_joint_actuator(spec, joint)]
    return [actuator for actuator in spec.actuators if find_driven_joint(spec, actuator) is not None]
