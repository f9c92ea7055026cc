"""Dead band and least torque of a position servo: it moves a goal joint, to which passive actuators pull its joint."""

import mujoco
import numpy as np

from nas_data.effects.edits.passive import add_feedback
from nas_data.effects.edits.pristine import clear_joint, clear_tendon
from nas_data.effects.edits.servo import (
    limit_force,
    limit_torque,
    multiply_servo,
    read_band,
    read_force_range,
    read_position_feedback,
)
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import BAND, DAMPING, DRIVE, GOAL, GOAL_GAIN, PARTS, START, START_BAND
from nas_data.mjcf.unique_name import make_unique_name

JOINT_COEFFICIENT = 1e-4  # coefficient of the joint in the servo's tendon; that of the goal is 1
GOAL_INERTIA_RATIO = 1 / 200  # goal's inertia over damping · timestep, so that it moves within one physics step
MIN_GOAL_INERTIA = (
    2e-9  # [s²] goal's least inertia per stiffness: MuJoCo takes accelerations over 1e10 rad/s² for a divergence
)
START_STIFFNESS = 0.5  # stiffness · timestep² / inertia of the start torque about zero error; at 4 it oscillates
MASS, INERTIA = 1e-9, 1e-12  # [kg], [kg m²] of the goal's body; MuJoCo requires positive values


def add_band(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, half_width: float) -> None:
    """Let a servo ignore errors of up to `half_width` [rad], in addition to an existing dead band.

    The servo, with its control, delay and slew rate, moves a massless goal joint within one physics step. Three passive
    actuators act between goal and joint. `<joint>_deadband_gain` has the servo's stiffness. `<joint>_deadband` cancels
    it up to the torque at the band's edge. `<joint>_deadband_damping` has the servo's damping. The servo also acts on
    the joint directly, with a share that compensates the delay of the goal: a new command acts at once.

    Raises:
        ModelFileError: the model uses one of these names for another element.
    """
    if spec.actuator(joint + GOAL_GAIN) is None:
        insert_goal(spec, joint, servo)
    present, torque = read_band(spec, joint)
    set_band(spec, joint, present + half_width, torque)


def add_start_torque(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, torque: float) -> None:
    """Raise a servo's torque to `torque` [N·m] at least wherever it acts; of two such torques the larger one holds.

    The dead band's actuator cancels the proportional torque up to `torque` beyond the band's edge, and
    `<joint>_start_torque` gives `torque` in its place. It is a much stiffer spring with a limit, so that the simulation
    is stable at its timestep: within torque / stiffness of the goal the torque is proportional to the error.

    Raises:
        ModelFileError: the model uses one of these names for another element.
    """
    if spec.actuator(joint + GOAL_GAIN) is None:
        insert_goal(spec, joint, servo)
    half_width, present = read_band(spec, joint)
    set_band(spec, joint, half_width, max(torque, present))


def replace_band(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, band: tuple[float, float]) -> None:
    """Set a servo's dead band [rad] and start torque [N·m] in place of those that it has; 0 for none.

    Raises:
        ModelFileError: the model uses one of the names for another element, or the servo has an integral gain.
    """
    if spec.actuator(joint + GOAL_GAIN) is None and any(band):
        insert_goal(spec, joint, servo)
    for part in (BAND, START, START_BAND):
        if (actuator := spec.actuator(joint + part)) is not None:
            spec.delete(actuator)
    if any(band):
        set_band(spec, joint, *band)


def set_band(spec: mujoco.MjSpec, joint: str, half_width: float, torque: float) -> None:
    """Set a servo's dead band [rad] and start torque [N·m]; the servo has a goal joint.

    With z(e) the error beyond the band, the torque is kp · e − clip(kp · e, ±(kp · half_width + torque)), and with a
    start torque in addition clip(k · z(e), ±torque), written as clip(k · e, ±(k · half_width + torque)) −
    clip(k · e, ±k · half_width).
    """
    gain = spec.actuator(joint + GOAL_GAIN)
    error, stiffness = gain.target, -float(gain.biasprm[1])
    if spec.actuator(joint + BAND) is None:
        add_feedback(spec, joint + BAND, error, stiffness, 0.0)
    limit_force(spec.actuator(joint + BAND), stiffness * half_width + torque)
    if not torque:
        return
    if spec.actuator(joint + START) is None:
        model = spec.compile()
        inertia = 1 / float(model.dof_invweight0[model.joint(joint).dofadr[0]])  # at the reference posture [kg·m²]
        add_feedback(
            spec, joint + START, error, -max(START_STIFFNESS * inertia / spec.option.timestep**2, stiffness), 0.0
        )
    steep = -float(spec.actuator(joint + START).biasprm[1])
    limit_force(spec.actuator(joint + START), steep * half_width + torque)
    if half_width:
        if spec.actuator(joint + START_BAND) is None:
            add_feedback(spec, joint + START_BAND, error, steep, 0.0)
        limit_force(spec.actuator(joint + START_BAND), steep * half_width)


def insert_goal(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator) -> None:
    """Insert a goal joint between a servo and its joint; the torque is unchanged.

    Raises:
        ModelFileError: the model uses one of the names for another element, or the servo has an integral gain.
    """
    refuse_integral(servo)
    refuse_names(spec, joint)
    first, gear = spec.joint(joint), float(servo.gear[0])
    kp, kv = read_position_feedback(servo) * gear**2, -float(servo.biasprm[2]) * gear**2
    move_dampers(first, servo)
    limits = read_force_range(servo)
    servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_FALSE, [0.0, 0.0]
    multiply_servo(spec, joint, servo, 1 / JOINT_COEFFICIENT)
    servo.biasprm = np.where(np.arange(len(servo.biasprm)) == 2, 0.0, servo.biasprm)
    goal = add_goal(spec, first, kp / JOINT_COEFFICIENT)
    servo.trntype = mujoco.mjtTrn.mjTRN_TENDON
    servo.target = add_sum(spec, joint + DRIVE, {goal.name: 1.0, joint: JOINT_COEFFICIENT})
    # the servo's tendon includes this share of the joint already
    error = add_sum(
        spec, make_unique_name(spec.tendon, joint + "_error"), {joint: 1 - JOINT_COEFFICIENT, goal.name: -1.0}
    )
    add_feedback(spec, joint + GOAL_GAIN, error, -kp, 0.0)
    if kv:
        angle = add_sum(spec, make_unique_name(spec.tendon, joint + "_turn"), {joint: 1.0})
        add_feedback(spec, joint + DAMPING, angle, 0.0, -kv)
    if limits is not None:
        limit_torque(first, *np.sort(np.array(limits) * gear))


def refuse_integral(servo: mujoco.MjsActuator) -> None:
    """Refuse a servo with an integral gain, whose goal and torque cannot be separated.

    Raises:
        ModelFileError: names the actuator.
    """
    if servo.gaintype == mujoco.mjtGain.mjGAIN_PID and servo.gainprm[0]:
        raise ModelFileError(
            f"No dead band, start torque or acceleration limit can be added to the actuator '{servo.name}', because of "
            "its integral gain; give a model without ki."
        )


def refuse_names(spec: mujoco.MjSpec, joint: str) -> None:
    """Refuse a model that uses a name of the added elements for another element.

    Raises:
        ModelFileError: names the element.
    """
    wanted = [(spec.joint, joint + GOAL), (spec.tendon, joint + DRIVE), *((spec.actuator, joint + p) for p in PARTS)]
    taken = [name for find, name in wanted if find(name) is not None]
    if taken:
        raise ModelFileError(
            f"The servo of the joint '{joint}' cannot be changed: the model has something else named '{taken[0]}'; "
            "give that another name."
        )


def move_dampers(joint: mujoco.MjsJoint, servo: mujoco.MjsActuator) -> None:
    """Move the actuator's damping and armature to the joint, so that they do not act on the goal."""
    joint.damping = joint.damping + servo.damping * servo.gear[0] ** 2
    joint.armature += servo.armature * servo.gear[0] ** 2
    servo.damping, servo.armature = np.zeros(3), 0.0


def add_goal(spec: mujoco.MjSpec, first: mujoco.MjsJoint, stiffness: float) -> mujoco.MjsJoint:
    """Add the goal: a joint on its own body that a servo of this stiffness moves within one physics step."""
    step = spec.option.timestep
    name = first.name + GOAL
    body = spec.worldbody.add_body(mass=MASS, inertia=np.full(3, INERTIA), explicitinertial=True)
    body.name, body.ipos = make_unique_name(spec.body, name), np.zeros(3)
    goal = body.add_joint(name=name, type=first.type, axis=[0, 0, 1])
    clear_joint(goal)
    goal.damping = [stiffness * step, 0.0, 0.0]
    goal.armature = stiffness * max(GOAL_INERTIA_RATIO * step**2, MIN_GOAL_INERTIA)
    return goal


def add_sum(spec: mujoco.MjSpec, name: str, parts: dict[str, float]) -> str:
    """Add a fixed tendon without forces of its own, from coefficients by joint; return its name."""
    tendon = spec.add_tendon(name=name)
    clear_tendon(tendon)
    for joint, share in parts.items():
        tendon.wrap_joint(joint, share)
    return name
