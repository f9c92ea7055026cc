"""A dead band of a position servo, which then drives a goal that passive actuators make the joint follow."""

import mujoco
import numpy as np

from nas_data.effects.edits.passive import add_passive
from nas_data.effects.edits.pristine import clear_joint, clear_tendon
from nas_data.effects.edits.servo import feedback, limit_torque, multiply_servo, torque_limits
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import BAND, DAMPING, DRIVE, GAIN, GOAL, PARTS
from nas_data.mjcf.unique_name import free_name

SHARE = 1e-4  # stiffness that the servo leaves to the joint over the one with which it moves the goal
QUICK = 1 / 200  # of the goal's damping · timestep is its inertia: it arrives within one physics step
CALM = 2e-9  # [s²] its least inertia per stiffness: the engine takes an acceleration over 1e10 rad/s² for a divergence
MASS, INERTIA = 1e-9, 1e-12  # [kg], [kg m²] of the goal's body, which must have some


def add_band(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, half_width: float) -> None:
    """Let a servo ignore errors of up to `half_width` [rad]; a band that is there already becomes wider.

    The servo, with its control, delay and slew rate, moves a weightless goal within one physics step. Between goal and
    joint act passive actuators: `<joint>_deadband_gain` as the servo's stiffness, `<joint>_deadband` which takes that
    away again up to the torque at the band's edge, and `<joint>_deadband_damping`. Of its own stiffness the servo
    leaves the joint as much as the goal is late by: a new command is felt at once.

    Raises:
        ModelFileError: the model gives something else one of these names.
    """
    if spec.actuator(joint + BAND) is None:
        put_goal_between(spec, joint, servo)
    band = spec.actuator(joint + BAND)
    torque = float(band.forcerange[1]) + float(band.biasprm[1]) * half_width
    band.forcelimited, band.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-torque, torque]


def put_goal_between(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator) -> None:
    """Let the servo drive a goal, and passive actuators with its gains the joint; without a band the same torque."""
    refuse_names(spec, joint)
    first, gear = spec.joint(joint), float(servo.gear[0])
    kp, kv = feedback(servo) * gear**2, -float(servo.biasprm[2]) * gear**2
    move_dampers(first, servo)
    limits = torque_limits(servo)
    servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_FALSE, [0.0, 0.0]
    multiply_servo(spec, joint, servo, 1 / SHARE)
    servo.biasprm = np.where(np.arange(len(servo.biasprm)) == 2, 0.0, servo.biasprm)
    goal = add_goal(spec, first, kp / SHARE)
    servo.trntype = mujoco.mjtTrn.mjTRN_TENDON
    servo.target = add_sum(spec, joint + DRIVE, {goal.name: 1.0, joint: SHARE})
    # the servo's share counts the joint already
    error = add_sum(spec, free_name(spec.tendon, joint + "_error"), {joint: 1 - SHARE, goal.name: -1.0})
    add_feedback(spec, joint + GAIN, error, -kp, 0.0)
    add_feedback(spec, joint + BAND, error, kp, 0.0)
    turn = add_sum(spec, free_name(spec.tendon, joint + "_turn"), {joint: 1.0})
    add_feedback(spec, joint + DAMPING, turn, 0.0, -kv)
    if limits is not None:
        limit_torque(first, *np.sort(np.array(limits) * gear))


def refuse_names(spec: mujoco.MjSpec, joint: str) -> None:
    """Refuse a model in which something has the name of a part by which a servo with a dead band is known."""
    wanted = [(spec.joint, joint + GOAL), (spec.tendon, joint + DRIVE), *((spec.actuator, joint + p) for p in PARTS)]
    taken = [name for find, name in wanted if find(name) is not None]
    if taken:
        raise ModelFileError(
            f"deadband cannot be added to the joint '{joint}': the model has something else named '{taken[0]}'; "
            "give that another name."
        )


def move_dampers(joint: mujoco.MjsJoint, servo: mujoco.MjsActuator) -> None:
    """Move damping and rotor inertia that an actuator adds to what it drives to the joint, away from the goal."""
    joint.damping = joint.damping + servo.damping * servo.gear[0] ** 2
    joint.armature += servo.armature * servo.gear[0] ** 2
    servo.damping, servo.armature = np.zeros(3), 0.0


def add_goal(spec: mujoco.MjSpec, first: mujoco.MjsJoint, stiffness: float) -> mujoco.MjsJoint:
    """Add a joint on a body of its own in the world that a servo of this stiffness moves within one physics step."""
    step = spec.option.timestep
    name = first.name + GOAL
    body = spec.worldbody.add_body(mass=MASS, inertia=np.full(3, INERTIA), explicitinertial=True)
    body.name, body.ipos = free_name(spec.body, name), np.zeros(3)
    goal = body.add_joint(name=name, type=first.type, axis=[0, 0, 1])
    clear_joint(goal)
    goal.damping = [stiffness * step, 0.0, 0.0]
    goal.armature = stiffness * max(QUICK * step**2, CALM)
    return goal


def add_sum(spec: mujoco.MjSpec, name: str, parts: dict[str, float]) -> str:
    """Add a fixed tendon without a mechanics of its own; return its name."""
    tendon = spec.add_tendon(name=name)
    clear_tendon(tendon)
    for joint, share in parts.items():
        tendon.wrap_joint(joint, share)
    return name


def add_feedback(spec: mujoco.MjSpec, name: str, tendon: str, per_length: float, per_speed: float) -> None:
    """Add an actuator without a control whose force is proportional to a tendon's length and speed."""
    actuator = add_passive(spec, name, mujoco.mjtTrn.mjTRN_TENDON, tendon)
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    bias = np.zeros_like(actuator.biasprm)
    bias[1:3] = per_length, per_speed
    actuator.biasprm = bias
