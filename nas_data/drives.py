"""Which joint an actuator drives: directly, or through the tendon that adds slack to it."""

import mujoco
import numpy as np

DRIVE = "_drive"  # a fixed tendon `<joint>_drive` stands for its joint: the joint plus what a servo's slack takes up


def driven_joint(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str | None:
    """Return the name of the joint that an actuator with a control drives; None for passive and other actuators."""
    if actuator.ctrlspec == int(mujoco.mjtCtrlInput.mjINPUT_NONE):
        return None
    if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
        return str(actuator.target)
    joint = actuator.target.removesuffix(DRIVE)
    slack = actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and joint != actuator.target
    return joint if slack and spec.joint(joint) is not None else None


def driving_actuators(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Return the indices of the actuators with a control that drive a joint of a compiled model."""
    tendon = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, model.joint(joint).name + DRIVE)
    kind, target = model.actuator_trntype, model.actuator_trnid[:, 0]
    direct = (kind == int(mujoco.mjtTrn.mjTRN_JOINT)) & (target == joint)
    slack = (kind == int(mujoco.mjtTrn.mjTRN_TENDON)) & (target == tendon) & (tendon >= 0)
    return np.flatnonzero((direct | slack) & (model.actuator_ctrlnum > 0))
