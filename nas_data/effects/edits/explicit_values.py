"""Explicit numbers in place of what the compiler derives from others, or flags of the model switch off."""

from collections.abc import Sequence

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import ON_JOINT

KEPT_RANGE = {
    mujoco.mjtDyn.mjDYN_INTEGRATOR: "act"
}  # whose range is inherited; of all others it is that of the control
MEASURABLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
FLAG = mujoco.mjtDisableBit
CONSTRAINTS = (FLAG.mjDSBL_EQUALITY, FLAG.mjDSBL_FRICTIONLOSS, FLAG.mjDSBL_LIMIT, FLAG.mjDSBL_CONTACT)
SWITCHED_OFF = (  # flag, attribute of joints and tendons, and its value without the force
    (FLAG.mjDSBL_SPRING, "stiffness", np.zeros(3)),
    (FLAG.mjDSBL_DAMPER, "damping", np.zeros(3)),
    (FLAG.mjDSBL_FRICTIONLOSS, "frictionloss", 0.0),
    (FLAG.mjDSBL_LIMIT, "limited", mujoco.mjtLimited.mjLIMITED_FALSE),
)


def make_values_explicit(spec: mujoco.MjSpec) -> None:
    """Replace derived values and switched-off forces by the numbers that they mean in this model.

    Later edits then do not change them. An effect may also move a servo to a tendon or to a joint of its own, which has
    no range to inherit, or add a force of a kind that the model switches off.
    """
    _apply_disable_flags(spec)
    servos = [
        (index, servo) for index, servo in enumerate(spec.actuators) if servo.biasprm[2] > 0 or servo.inheritrange > 0
    ]
    damped = [(index, joint) for index, joint in enumerate(spec.joints) if np.any(joint.springdamper)]
    if servos or damped:
        _fix_derived(servos, damped, spec.copy().compile())
    for actuator in spec.actuators:
        if actuator.trntype in ON_JOINT and spec.joint(actuator.target).type in MEASURABLE:
            _move_to_joint(actuator, spec.joint(actuator.target))


def _fix_derived(
    servos: Sequence[tuple[int, mujoco.MjsActuator]],
    damped: Sequence[tuple[int, mujoco.MjsJoint]],
    model: mujoco.MjModel,
) -> None:
    """Take damping ratios and inherited ranges, and springs and dampers of joints, from the compiled model."""
    for index, servo in servos:
        servo.biasprm = model.actuator_biasprm[index]
        if servo.inheritrange > 0:
            kind = KEPT_RANGE.get(servo.dyntype, "ctrl")
            setattr(servo, f"{kind}range", getattr(model, f"actuator_{kind}range")[index])
            setattr(servo, f"{kind}limited", mujoco.mjtLimited.mjLIMITED_TRUE)
            servo.inheritrange = 0
    for index, joint in damped:
        joint.springdamper = np.zeros(2)
        joint.stiffness = [model.jnt_stiffness[index], 0.0, 0.0]
        joint.damping = [model.dof_damping[model.jnt_dofadr[index]], 0.0, 0.0]


def _move_to_joint(actuator: mujoco.MjsActuator, joint: mujoco.MjsJoint) -> None:
    """Move an actuator's own inertia and damping to its joint, where effects and base parameters change them."""
    if actuator.damping[1:].any() or not (actuator.armature or actuator.damping[0]):
        return
    gear = float(actuator.gear[0])
    joint.armature += gear**2 * actuator.armature
    joint.damping = joint.damping + gear**2 * actuator.damping
    actuator.armature, actuator.damping = 0.0, np.zeros(3)


def _apply_disable_flags(spec: mujoco.MjSpec) -> None:
    """Remove the springs, dampers, frictions, limits and equalities that flags of the model switch off, and the flags.

    The model moves as before. With the flags, a force that an effect adds would be switched off, too.
    """
    if _take_flag(spec.option, FLAG.mjDSBL_CONSTRAINT):
        for kind in CONSTRAINTS:
            spec.option.disableflags |= int(kind)
    for flag, attribute, none in SWITCHED_OFF:
        if _take_flag(spec.option, flag):
            for element in (*spec.joints, *spec.tendons):
                setattr(element, attribute, none)
    if _take_flag(spec.option, FLAG.mjDSBL_EQUALITY):
        for equality in spec.equalities:
            equality.active = False


def _take_flag(option: mujoco.MjOption, flag: mujoco.mjtDisableBit) -> bool:
    """Clear a disable flag; return whether it was set."""
    was_set = bool(option.disableflags & int(flag))
    option.disableflags &= ~int(flag)
    return was_set
