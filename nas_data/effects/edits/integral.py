"""Integral part of a servo's position loop in an `MjSpec`."""

import mujoco

from nas_data.effects.base import find_joint_actuator

BOUND, SLEW = 0, 1  # indices of a <pid>'s bound of the integral and of its slew rate in `dynprm`


def has_integral(spec: mujoco.MjSpec, joint: str) -> bool:
    """Whether a joint's servo has an integral gain."""
    servo = find_joint_actuator(spec, joint)
    return bool(servo.gaintype == mujoco.mjtGain.mjGAIN_PID and servo.gainprm[0] > 0)


def scale_integral(spec: mujoco.MjSpec, joint: str, factor: float) -> None:
    """Multiply a servo's integral gain; the limit of the integral's torque stays."""
    servo = find_joint_actuator(spec, joint)
    gain, parameters = servo.gainprm.copy(), servo.dynprm.copy()
    gain[0] *= factor
    parameters[BOUND] = parameters[BOUND] / factor if factor else 0.0  # the gain multiplies the integral
    servo.gainprm, servo.dynprm = gain, parameters
    drop_unused_memory(servo)


def drop_unused_memory(servo: mujoco.MjsActuator) -> None:
    """Take the state from a <pid> without integral and slew rate, because MuJoCo refuses an empty state."""
    if not servo.gainprm[0] and not servo.dynprm[SLEW]:
        servo.dyntype = mujoco.mjtDyn.mjDYN_NONE
