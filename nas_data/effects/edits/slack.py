"""Slack in a servo's feedback: it drives the sum of its joint and of a weightless joint between two stops."""

import math

import mujoco
import numpy as np

from nas_data.drives import DRIVE
from nas_data.effects.backlash import HARD_STOP
from nas_data.effects.edits.series import angle, clear_defaults
from nas_data.effects.edits.servo import stiffness

STEPS = 3.0  # physics steps in which the slack's own oscillation turns by a radian; fewer would not resolve it
DAMPING = 0.3  # part of critical damping of that oscillation; more would drag on the joint
CALM = 1.0  # 4 would keep it below the limit when the full torque throws it all the way
MASS, INERTIA = 1e-9, 1e-12  # [kg], [kg m²] of the slack's body, which must have some


def add_slack(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, half_width: float) -> None:
    """Let a servo drive its joint plus a slack of ± `half_width` [rad]; existing slack becomes wider."""
    slack = spec.joint(f"{joint}_slack")
    if slack is None:
        settle_damping(spec, servo)
        slack = add_free_joint(spec, spec.joint(joint), f"{joint}_slack")
        slack.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        slack.solref_limit = [2 * spec.option.timestep, 1.0]
        slack.solimp_limit = HARD_STOP
        move_dampers(spec.joint(joint), servo)
        move_limit(spec.joint(joint), servo)
        drive_both(spec, joint, slack, servo, half_width)
    width = float(slack.range[1]) + angle(spec, half_width)
    slack.range = [-width, width]


def settle_damping(spec: mujoco.MjSpec, servo: mujoco.MjsActuator) -> None:
    """Replace a damping ratio by its damping, which the compiler would otherwise compute for the slack."""
    if servo.biasprm[2] > 0:
        servo.biasprm = spec.compile().actuator(servo.name).biasprm


def add_free_joint(spec: mujoco.MjSpec, first: mujoco.MjsJoint, name: str) -> mujoco.MjsJoint:
    """Add a joint of the same kind on a body of its own in the world."""
    body = spec.worldbody.add_body(name=name, mass=MASS, inertia=np.full(3, INERTIA), explicitinertial=True)
    body.ipos = np.zeros(3)
    joint = body.add_joint(name=name, type=first.type, axis=[0, 0, 1])
    clear_defaults(joint)
    return joint


def move_dampers(joint: mujoco.MjsJoint, servo: mujoco.MjsActuator) -> None:
    """Move damping and rotor inertia that an actuator adds to what it drives to the joint, away from the slack."""
    joint.damping = joint.damping + servo.damping * servo.gear[0] ** 2
    joint.armature += servo.armature * servo.gear[0] ** 2
    servo.damping, servo.armature = np.zeros(3), 0.0


def move_limit(joint: mujoco.MjsJoint, servo: mujoco.MjsActuator) -> None:
    """Move a servo's torque limit to what arrives at the joint: slack whose damping is cut off would run away."""
    limited = servo.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        servo.forcelimited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(np.any(servo.forcerange))
    )
    if not limited:
        return
    low, high = np.sort(servo.forcerange * servo.gear[0])
    if joint.actfrclimited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(joint.actfrcrange):
        low, high = max(low, joint.actfrcrange[0]), min(high, joint.actfrcrange[1])
    joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high]
    servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_FALSE, [0.0, 0.0]


def drive_both(
    spec: mujoco.MjSpec, joint: str, slack: mujoco.MjsJoint, servo: mujoco.MjsActuator, half_width: float
) -> None:
    """Make the sum of joint and slack what the servo drives and feels, its damping the joint's alone.

    The servo damps the sum; the tendon takes that away again and the joint gets it back. Only a torque at its limit
    has no damping in it, as without slack.
    """
    first = spec.joint(joint)
    gear = float(servo.gear[0]) ** 2
    kp, kv = stiffness(servo) * gear, -float(servo.biasprm[2]) * gear
    slack.armature = max(kp * (STEPS * spec.option.timestep) ** 2, calm(first, kv, half_width))
    slack.damping = [2 * DAMPING * math.sqrt(kp * slack.armature), 0.0, 0.0]
    tendon = spec.add_tendon(name=joint + DRIVE, damping=[-kv, 0.0, 0.0], stiffness=np.zeros(3), frictionloss=0.0)
    tendon.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    tendon.wrap_joint(joint, 1.0)
    tendon.wrap_joint(slack.name, 1.0)
    first.damping = first.damping + np.array([kv, 0.0, 0.0])
    servo.trntype, servo.target = mujoco.mjtTrn.mjTRN_TENDON, tendon.name


def calm(joint: mujoco.MjsJoint, kv: float, half_width: float) -> float:
    """Return the inertia [kg m²] with which slack that the servo throws from stop to stop stays slow enough.

    The servo damps slack and joint alike, and the tendon gives the joint back what it damps of the slack. What the
    torque limit cuts off of that damping is given back all the same: a kick.
    """
    limit = float(np.abs(joint.actfrcrange).max())
    return CALM * half_width * kv**2 / limit if limit > 0 else 0.0
