"""The position servo of a joint in an editable model."""

from collections.abc import Iterable

import mujoco

from nas_data.drives import driven_joint
from nas_data.effects.base import joint_actuator
from nas_data.errors import ModelFileError


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
    if stiffness(actuator) <= 0:
        raise ModelFileError(
            f"{effect} acts on a position servo; the actuator '{actuator.name}' of the joint '{joint}' has no "
            "position feedback: give a model whose actuators are <position> or <pid>."
        )
    return actuator


def stiffness(actuator: mujoco.MjsActuator) -> float:
    """Return a servo's torque per position error [N·m/rad]; 0 for an actuator without position feedback."""
    return -float(actuator.biasprm[1])


def scale_stiffness(actuator: mujoco.MjsActuator, factor: float) -> None:
    """Multiply a servo's position gain; its damping stays, and so does the angle at which it comes to rest."""
    bias = actuator.biasprm.copy()
    bias[:2] *= factor
    actuator.biasprm = bias
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED:
        gain = actuator.gainprm.copy()
        gain[0] *= factor
        actuator.gainprm = gain


def shift_rest(actuator: mujoco.MjsActuator, offset: float) -> None:
    """Let a servo come to rest at its command plus an offset [rad]."""
    bias = actuator.biasprm.copy()
    bias[0] += stiffness(actuator) * offset
    actuator.biasprm = bias


def actuators_of(spec: mujoco.MjSpec, joint: str | None) -> Iterable[mujoco.MjsActuator]:
    """Return the actuator of one joint, or all that drive a joint where it is None."""
    if joint is not None:
        return [joint_actuator(spec, joint)]
    return [actuator for actuator in spec.actuators if driven_joint(spec, actuator) is not None]
