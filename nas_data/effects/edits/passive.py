"""Actuators without a control, for what a joint does by itself."""

import mujoco
import numpy as np


def add_passive(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtTrn, target: str, lugre: np.ndarray | None = None
) -> mujoco.MjsActuator:
    """Add an actuator without a control on a joint or tendon, none of it from the model's default class.

    Only a motor may go without a control. This one has no motor constant, so that no current flows: left are LuGre
    friction (stiffness, damping, torque at speed, torque at rest, Stribeck velocity), or the bias that a caller gives.
    """
    actuator = spec.add_actuator(name=name, target=target)
    actuator.trntype = kind
    actuator.set_to_dcmotor(
        motorconst=np.zeros(2),
        resistance=1.0,  # must be positive
        lugre=np.zeros(5) if lugre is None else lugre,
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )
    for field in ("forcelimited", "ctrllimited", "actlimited"):
        setattr(actuator, field, mujoco.mjtLimited.mjLIMITED_FALSE)
    actuator.gear = [1.0, *np.zeros(5)]
    actuator.forcerange = actuator.ctrlrange = actuator.actrange = np.zeros(2)
    actuator.delay = actuator.armature = 0.0
    actuator.nsample, actuator.damping = 0, np.zeros(3)
    return actuator
