"""Acceleration profile of a servo: its goal joint is heavy, and moved by a limited force."""

import math

import mujoco
import numpy as np

from nas_data.effects.edits.band import add_sum, insert_goal
from nas_data.effects.edits.passive import add_passive
from nas_data.effects.edits.servo import limit_torque, multiply_servo, read_position_feedback
from nas_data.mjcf.actuator_lookup import DRIVE, GOAL, GOAL_GAIN, PROFILE

# Measured on random steps of up to 2 rad and on sines, at 4 to 50 rad/s² and timesteps of 1 and 2 ms: the goal deviates
# from the ideal profile by 0.04° to 0.6° (RMS).
RATE = 0.35  # most natural frequency of the goal times the timestep: faster oscillates
FASTEST = 175.0  # [rad/s] most natural frequency of the goal, so that timesteps below 2 ms make no difference
REACTION = 1e-5  # torque of the servo at an error of a radian over the force that accelerates the goal
REST = 0.5  # distance from the command at which the goal rests, over acceleration / natural frequency²
FARTHEST_REST = 3e-4  # [rad; m] largest such distance, below the resolution of sensors
BRISTLE = 400.0  # stiffness of the brake's bristles; with less the brake is late
ARRIVAL = 0.5  # damping of the arrival over inertia · frequency; with more a moving goal is late
FAST = 100.0  # Stribeck velocity over the top speed of a step of a radian, so that the brake is quadratic below it


def limit_goal_acceleration(spec: mujoco.MjSpec, joint: str, servo: mujoco.MjsActuator, acceleration: float) -> None:
    """Let a servo's goal follow its command with a bounded acceleration [rad/s²]; of two bounds the lower one holds.

    With the force F, distance to the command e and speed v, the goal's equation of motion is

        inertia · dv/dt = clip(F, ±inertia · acceleration)
        F = inertia · ω² · (e − v · |v| / (2 · acceleration) − ARRIVAL · v / ω)

    A goal at speed v needs v² / (2 · acceleration) to stop, so that it speeds up and then brakes at the bound. The
    quadratic term is LuGre friction that grows with speed, of a passive actuator `<joint>_acceleration_limit`, because
    damping of a joint is not within the clip (`actuatorfrcrange` of the goal joint). The last term damps the arrival.
    The goal is so heavy that the servo's torque does not move it.

    Raises:
        ModelFileError: the model uses one of these names for another element, or the servo has an integral gain.
    """
    if spec.actuator(joint + GOAL_GAIN) is None:
        insert_goal(spec, joint, servo)
    goal = spec.joint(joint + GOAL)
    if spec.actuator(joint + PROFILE) is not None:
        acceleration = min(acceleration, float(goal.actfrcrange[1]) / goal.armature)
        spec.delete(spec.actuator(joint + PROFILE))
    kp = -float(spec.actuator(joint + GOAL_GAIN).biasprm[1])
    inertia = kp / (REACTION * acceleration)
    frequency = min(RATE / spec.option.timestep, FASTEST)
    stiffness, damping = inertia * frequency**2, ARRIVAL * inertia * frequency
    # the share of the joint in the drive, by which a new command acts at once, would bypass the profile
    spec.delete(spec.tendon(joint + DRIVE))
    add_sum(spec, joint + DRIVE, {goal.name: 1.0})
    multiply_servo(spec, joint, servo, stiffness / (read_position_feedback(servo) * float(servo.gear[0]) ** 2))
    goal.damping, goal.armature = np.zeros(3), inertia
    goal.actfrcrange = np.zeros(2)
    limit_torque(goal, -inertia * acceleration, inertia * acceleration)
    add_passive(
        spec,
        joint + PROFILE,
        mujoco.mjtTrn.mjTRN_JOINT,
        goal.name,
        compute_brake(stiffness, acceleration, frequency),
        damping,
    )


def compute_brake(stiffness: float, acceleration: float, frequency: float) -> np.ndarray:
    """Return the LuGre parameters of a friction of stiffness · v² / (2 · acceleration), shape (5,).

    LuGre friction is static + (coulomb − static) · (1 − exp(−(v / stribeck)²)), which is quadratic in v well below the
    Stribeck velocity. The static part is needed, because the length of the bristles is friction over their stiffness.
    """
    rest = min(REST * acceleration / frequency**2, FARTHEST_REST)
    quadratic, static = stiffness / (2 * acceleration), stiffness * rest
    stribeck = FAST * math.sqrt(2 * acceleration)
    bristles = BRISTLE * math.sqrt(static * quadratic) * frequency
    return np.array([bristles, 0.0, static + quadratic * stribeck**2, static, stribeck])
