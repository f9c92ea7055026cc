"""Which joint an actuator drives: directly, or by a fixed tendon that stands for the joint."""

import mujoco
import numpy as np

HELD = "_held"  # the constraint `<joint>_held`; without it the joint is as its author made it
WIDEST_PLAY = 0.2  # [rad] half width up to which a hinge with stops is a joint's play
# Parts of a servo with a dead band are known by these names, which are such that nobody's model has them by chance.
DRIVE = "_deadband_drive"  # a fixed tendon `<joint>_deadband_drive` stands for its joint: the goal its servo follows
GOAL = "_deadband_goal"  # a weightless joint in the world, which is where the servo's goal is
# passive actuators: what such a servo then gives the joint
GAIN, BAND, DAMPING = "_deadband_gain", "_deadband", "_deadband_damping"
PARTS = (GAIN, BAND, DAMPING)
PRESSED = "_pressed_drive"  # a fixed tendon `<joint>_pressed_drive`: the joint and a pad that its servo presses
PAD = "_pressed_pad"  # that pad's joint, in the body that holds the servo's
STANDING = (DRIVE, PRESSED)  # ends of the names of fixed tendons that stand for a joint
REST_SHIFT = (
    "_rest_shift"  # a number `<joint>_rest_shift` of the model: what of its servo's constant force an effect added
)
ON_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)  # alike for hinges and slides
DIRECT, TENDON = tuple(map(int, ON_JOINT)), int(mujoco.mjtTrn.mjTRN_TENDON)


def driven_joint(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str | None:
    """Return the name of the joint that an actuator with a control drives; None for passive and other actuators."""
    if actuator.ctrlspec == int(mujoco.mjtCtrlInput.mjINPUT_NONE):
        return None
    if actuator.trntype in ON_JOINT:
        return str(actuator.target)
    if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
        return None
    joints = [actuator.target.removesuffix(end) for end in STANDING if actuator.target.endswith(end)]
    return next((joint for joint in joints if spec.joint(joint) is not None), None)


def driving_actuators(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Return the indices of the actuators with a control that drive a joint of a compiled model, its servo first."""
    name = model.joint(joint).name
    tendons = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, name + end) for end in STANDING]
    target = model.actuator_trnid[:, 0]
    by_joint: list[int] = np.flatnonzero(target == joint).tolist()
    by_tendon: list[int] = []
    for tendon in tendons:
        by_tendon += np.flatnonzero(target == tendon).tolist() if tendon >= 0 else []
    kind, inputs = model.actuator_trntype, model.actuator_ctrlnum
    found = {actuator for actuator in by_joint if int(kind[actuator]) in DIRECT and inputs[actuator] > 0}
    found |= {actuator for actuator in by_tendon if kind[actuator] == TENDON and inputs[actuator] > 0}
    feedback = model.actuator_biasprm  # a servo feeds positions back
    return np.array(sorted(found, key=lambda actuator: (feedback[actuator, 1] == 0, actuator)), dtype=int)


def servo_actuators(model: mujoco.MjModel, joint: int) -> list[int]:
    """Return the indices of all actuators that are one joint's servo: the first that drives it, then its parts."""
    driving = driving_actuators(model, joint)[:1].tolist()
    name = model.joint(joint).name
    parts = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + part) for part in PARTS]
    return driving + [part for part in parts if part >= 0 and model.actuator_ctrlnum[part] == 0]


def leverage(model: mujoco.MjModel, actuator: int, joint: int) -> float:
    """Return the torque about a joint per unit of an actuator's force, which acts on it or on a fixed tendon."""
    gear = float(model.actuator_gear[actuator, 0])
    target = int(model.actuator_trnid[actuator, 0])
    if mujoco.mjtTrn(model.actuator_trntype[actuator]) in ON_JOINT:
        return gear if target == joint else 0.0
    wraps = slice(int(model.tendon_adr[target]), int(model.tendon_adr[target] + model.tendon_num[target]))
    return gear * float(model.wrap_prm[wraps][model.wrap_objid[wraps] == joint].sum())


def goal_joints(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the joints that are a servo's goal, which is no part of the robot."""
    names = [model.joint(index).name for index in range(model.njnt)]
    tendons = {model.tendon(index).name for index in range(model.ntendon)}
    return [
        index for index, name in enumerate(names) if name.endswith(GOAL) and name.removesuffix(GOAL) + DRIVE in tendons
    ]


def pad_joints(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the joints of pads that servos press, which are no part of the robot."""
    names = [model.joint(index).name for index in range(model.njnt)]
    return [index for index, name in enumerate(names) if name.endswith(PAD) and name.removesuffix(PAD) in names]
