"""Passive actuators: actuators without control."""

import mujoco
import numpy as np


def add_passive(
    spec: mujoco.MjSpec,
    name: str,
    kind: mujoco.mjtTrn,
    target: str,
    lugre: np.ndarray | None = None,
    damping: float = 0.0,
) -> mujoco.MjsActuator:
    """Add an actuator without control to a joint or tendon; the model's default classes do not affect it.

    In MuJoCo only a `<dcmotor>` can have no control. It only has LuGre friction, the bias that the caller sets, and the
    damping of its back-EMF, motor constant² / resistance, because it is shorted.

    Args:
        spec: Model.
        name: Name of the actuator.
        kind: Type of the transmission.
        target: Name of the joint or tendon.
        lugre: Stiffness, damping, torque at speed, torque at rest, Stribeck velocity, shape (5,); none if None.
        damping: Damping [N·m·s/rad], within the limits of actuator forces.
    """
    actuator = spec.add_actuator(name=name, target=target)
    actuator.trntype = kind
    actuator.set_to_dcmotor(
        motorconst=np.full(2, np.sqrt(damping)),
        resistance=1.0,  # MuJoCo requires a positive value
        lugre=np.zeros(5) if lugre is None else lugre,
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )
    for field in ("forcelimited", "ctrllimited", "actlimited"):
        setattr(actuator, field, mujoco.mjtLimited.mjLIMITED_FALSE)
    actuator.gear = [1.0, *np.zeros(5)]
    actuator.forcerange = actuator.ctrlrange = actuator.actrange = np.zeros(2)
    actuator.delay = actuator.armature = actuator.inheritrange = 0.0
    actuator.nsample, actuator.damping = 0, np.zeros(3)
    return actuator


def add_feedback(spec: mujoco.MjSpec, name: str, tendon: str, per_length: float, per_speed: float) -> None:
    """Add a passive actuator whose force is proportional to a tendon's length and speed."""
    set_bias(add_passive(spec, name, mujoco.mjtTrn.mjTRN_TENDON, tendon), 0.0, per_length, per_speed)


def set_bias(actuator: mujoco.MjsActuator, constant: float, per_length: float = 0.0, per_speed: float = 0.0) -> None:
    """Set the force of a passive actuator as a linear function of the length and speed of what it acts on."""
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    bias = np.zeros_like(actuator.biasprm)
    bias[:3] = constant, per_length, per_speed
    actuator.biasprm = bias
