"""Lookup of the joint that an actuator drives, directly or by a fixed tendon that was added for it."""

import mujoco
import numpy as np

HELD = "_held"  # the constraint `<joint>_held` locks a joint that its author left free
WIDEST_PLAY = 0.2  # [rad] largest half range of a hinge that counts as free play
# Names of the elements that model a servo with a dead band, start torque or acceleration limit; a model is unlikely to
# have them by chance.
DRIVE = "_deadband_drive"  # fixed tendon `<joint>_deadband_drive`, the servo's transmission: mainly the goal joint
GOAL = "_deadband_goal"  # joint in the world whose position is the servo's goal
PROFILE = "_acceleration_limit"  # passive actuator that brakes the goal joint, if its acceleration is limited
# passive actuators that apply the servo's torque to the joint
GOAL_GAIN, BAND, DAMPING = "_deadband_gain", "_deadband", "_deadband_damping"
START, START_BAND = "_start_torque", "_start_torque_band"  # the servo's least torque, and its dead band
PARTS = (GOAL_GAIN, BAND, DAMPING, START, START_BAND)
CURVE = "_motor_curve"  # passive actuator and fixed tendon `<joint>_motor_curve`: their torques depend on speed
PRESSED = "_pressed_drive"  # fixed tendon `<joint>_pressed_drive`: the joint and a pad that its servo presses
PAD = "_pressed_pad"  # joint of that pad, in the parent body
SHARED = "_shared_drive"  # fixed tendon `<joint>_shared_drive`: the joint and its followers, in the joint's unit
TRANSMISSIONS = (DRIVE, PRESSED, SHARED)  # suffixes of fixed tendons that replace a joint as a servo's transmission
REST_SHIFT = "_rest_shift"  # numeric `<joint>_rest_shift`: part of the servo's constant force that an effect added
ON_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)  # equivalent for hinges and slides
THROUGH = {  # transmissions that reach joints otherwise, as words
    mujoco.mjtTrn.mjTRN_TENDON: ("tendon", mujoco.mjtObj.mjOBJ_TENDON),
    mujoco.mjtTrn.mjTRN_SITE: ("site", mujoco.mjtObj.mjOBJ_SITE),
    mujoco.mjtTrn.mjTRN_SLIDERCRANK: ("slider-crank at the site", mujoco.mjtObj.mjOBJ_SITE),
    mujoco.mjtTrn.mjTRN_BODY: ("body", mujoco.mjtObj.mjOBJ_BODY),
}
DIRECT, TENDON = tuple(map(int, ON_JOINT)), int(mujoco.mjtTrn.mjTRN_TENDON)


def find_driven_joint(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str | None:
    """Return the name of the joint that an actuator drives; None for actuators without control or joint."""
    if actuator.ctrlspec == int(mujoco.mjtCtrlInput.mjINPUT_NONE):
        return None
    if actuator.trntype in ON_JOINT:
        return str(actuator.target)
    if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
        return None
    joints = [actuator.target.removesuffix(end) for end in TRANSMISSIONS if actuator.target.endswith(end)]
    return next((joint for joint in joints if spec.joint(joint) is not None), None)


def describe_transmission(model: mujoco.MjModel, actuator: int) -> str | None:
    """Return a phrase for an actuator's transmission in a compiled model; None if it acts on a joint."""
    word, kind = THROUGH.get(mujoco.mjtTrn(model.actuator_trntype[actuator]), ("", None))
    if kind is None:
        return None
    own = mujoco.mj_id2name(model, kind, int(model.actuator_trnid[actuator, 0]))
    return f"the {word} '{own}'" if own else f"a {word}"


def list_indirect_actuators(spec: mujoco.MjSpec) -> list[str]:
    """Return a phrase for each actuator with control that does not act on a joint directly."""
    found = []
    for actuator in spec.actuators:
        known = actuator.ctrlspec == int(mujoco.mjtCtrlInput.mjINPUT_NONE) or find_driven_joint(spec, actuator)
        if not known and actuator.trntype in THROUGH:
            own = f"'{actuator.name}'" if actuator.name else "one"
            found.append(f"{own} on the {THROUGH[actuator.trntype][0]} '{actuator.target}'")
    return found


def find_driving_actuators(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Return the indices of the actuators with control that drive a joint of a compiled model, servos first.

    Those of a group that the model switches off (`actuatorgroupdisable`) come last.
    """
    name = model.joint(joint).name
    tendons = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, name + end) for end in TRANSMISSIONS]
    target = model.actuator_trnid[:, 0]
    by_joint: list[int] = np.flatnonzero(target == joint).tolist()
    by_tendon: list[int] = []
    for tendon in tendons:
        by_tendon += np.flatnonzero(target == tendon).tolist() if tendon >= 0 else []
    kind, inputs = model.actuator_trntype, model.actuator_ctrlnum
    found = {actuator for actuator in by_joint if int(kind[actuator]) in DIRECT and inputs[actuator] > 0}
    found |= {actuator for actuator in by_tendon if kind[actuator] == TENDON and inputs[actuator] > 0}
    feedback = model.actuator_biasprm  # a servo has position feedback

    def rank(actuator: int) -> tuple[bool, bool, int]:
        return is_switched_off(model, actuator), bool(feedback[actuator, 1] == 0), actuator

    return np.array(sorted(found, key=rank), dtype=int)


def is_switched_off(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether the model switches off an actuator's group (`actuatorgroupdisable`)."""
    return is_group_off(int(model.actuator_group[actuator]), int(model.opt.disableactuator))


def is_group_off(group: int, switched_off: int) -> bool:
    """Whether the bits of `disableactuator` switch off a group of actuators; only 0 … 30 can be."""
    return 0 <= group <= 30 and bool(switched_off >> group & 1)


def find_servo_actuators(model: mujoco.MjModel, joint: int) -> list[int]:
    """Return the indices of the actuators that make up a joint's servo: the first that drives it, then its parts."""
    driving = find_driving_actuators(model, joint)[:1].tolist()
    name = model.joint(joint).name
    parts = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + part) for part in PARTS]
    return driving + [part for part in parts if part >= 0 and model.actuator_ctrlnum[part] == 0]


def compute_leverage(model: mujoco.MjModel, actuator: int, joint: int) -> float:
    """Return the torque about a joint per unit of an actuator's force on that joint or on a fixed tendon."""
    gear = float(model.actuator_gear[actuator, 0])
    target = int(model.actuator_trnid[actuator, 0])
    if mujoco.mjtTrn(model.actuator_trntype[actuator]) in ON_JOINT:
        return gear if target == joint else 0.0
    wraps = slice(int(model.tendon_adr[target]), int(model.tendon_adr[target] + model.tendon_num[target]))
    return gear * float(model.wrap_prm[wraps][model.wrap_objid[wraps] == joint].sum())


def find_goal_joints(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the goal joints of servos with a dead band; they are no part of the robot."""
    names = [model.joint(index).name for index in range(model.njnt)]
    tendons = {model.tendon(index).name for index in range(model.ntendon)}
    return [
        index for index, name in enumerate(names) if name.endswith(GOAL) and name.removesuffix(GOAL) + DRIVE in tendons
    ]


def find_slow_goals(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the indices of the goal joints whose acceleration is limited, each with that of its servo's joint."""
    pairs = [(goal, model.joint(goal).name.removesuffix(GOAL)) for goal in find_goal_joints(model)]
    return [
        (goal, int(model.joint(name).id))
        for goal, name in pairs
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + PROFILE) >= 0
    ]


def find_pad_joints(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the joints of pads that servos press; they are no part of the robot."""
    names = [model.joint(index).name for index in range(model.njnt)]
    return [index for index, name in enumerate(names) if name.endswith(PAD) and name.removesuffix(PAD) in names]
