"""Scales of joints, from which initial guesses of an effect's parameters are made."""

from dataclasses import replace

import mujoco
import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.dataset.features import EFFORT, POSITION
from nas_data.effects.base import Scales
from nas_data.effects.edits.servo import is_velocity_servo, read_servo_damping, read_servo_stiffness, read_torque_limit
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.poses import POSES, pose_arm
from nas_data.joint_units import compute_angle_scales
from nas_data.mjcf.arm_ends import list_arm_ends
from nas_data.mjcf.lowest_point import find_arm_geoms, find_first_anchor, find_lowest_point
from nas_data.robots.base import find_deepest_joint
from nas_data.simulators.controls import find_command, read_length_feedback


def estimate_scales(nominal: Nominal, evidence: EpisodeBatch, predicted: np.ndarray) -> tuple[Scales, ...]:
    """Return the scales of every joint.

    Args:
        nominal: Model.
        evidence: Measured episodes.
        predicted: The model's positions [rad; m], shape (E, T, n).
    """
    model = nominal.simulator().model
    moved = {p.joint: p.bodies for p in nominal.base if p.kind == "mass"}
    ends = [joint for joint in list_arm_ends(nominal.spec, nominal.joints) if joint in moved]
    outermost = find_deepest_joint(nominal.spec, ends or tuple(moved)) if moved else ""

    def weigh(joint: str) -> float:
        """Return the mass that the arm's last joint moves [kg]; of several arms, each last joint has its own."""
        bodies = moved.get(joint if joint in ends else outermost, ())
        return sum(float(nominal.spec.body(name).mass) for name in bodies) or 0.01

    measured, commanded = measure_depths(nominal, evidence)
    return tuple(
        replace(
            estimate_joint_scales(nominal, model, evidence, predicted, index, weigh(joint)),
            depth=measured,
            commanded_depth=commanded,
        )
        for index, joint in enumerate(nominal.joints)
    )


def measure_depths(nominal: Nominal, evidence: EpisodeBatch) -> tuple[float, float]:
    """Return how far the arm reaches below its first joint's axis in measured and in commanded poses [m].

    Both are 0 without collision shapes, and where a joint is not commanded a position.
    """
    simulator = nominal.simulator()
    model = simulator.model
    geoms = find_arm_geoms(model)
    if not geoms or set(simulator.kinds) != {POSITION}:
        return 0.0, 0.0
    rows = np.argwhere(evidence.mask)
    rows = rows[thin_evenly(len(rows), POSES)]
    top = float(find_first_anchor(model)[2])
    measured, commanded = (
        top - min(find_lowest_point(model, data, geoms) for data in pose_arm(simulator, poses[tuple(rows.T)]))
        for poses in (evidence.measured, evidence.commands)
    )
    return measured, commanded


def estimate_joint_scales(
    nominal: Nominal, model: mujoco.MjModel, evidence: EpisodeBatch, predicted: np.ndarray, index: int, mass: float
) -> Scales:
    """Return the scales of the joint of an index; `mass` is that moved by the last joint [kg]."""
    joint = nominal.joints[index]
    element = nominal.spec.joint(joint)
    gain = read_servo_stiffness(nominal.spec, joint)
    losses = float(element.damping[0]) + max(read_servo_damping(nominal.spec, joint), 0.0)
    inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
    speed = measure_large_speed(evidence, index)
    radian = find_radian(nominal, model, evidence, index)
    pulls = np.abs(compute_servo_torques(nominal, evidence, predicted, index))[evidence.mask]
    torque = min(read_torque_limit(nominal.spec, joint), float(np.percentile(pulls, 98)))
    stiffest = gain or max(torque, 1e-4) / radian
    return Scales(
        stiffness=stiffest,
        damping=losses,
        inertia=inertia,
        mass=mass,
        torque=max(torque, 1e-4),
        speed=max(speed, 1e-2 * radian),
        radian=radian,
        velocity_servo=is_velocity_servo(nominal.spec, joint),
        position_servo=gain > 0 and nominal.simulator().kinds[index] == POSITION,
    )


def find_radian(nominal: Nominal, model: mujoco.MjModel, evidence: EpisodeBatch, index: int) -> float:
    """Return the equivalent of a radian: 1 for a hinge; for a slide its range (or else its travel) over π [m]."""
    joint = nominal.joints[index]
    place = model.joint(joint).id
    travel = np.ptp(evidence.measured[..., index][evidence.mask])
    reach = np.ptp(model.jnt_range[place]) if model.jnt_limited[place] else travel
    return float(compute_angle_scales([joint], nominal.slides, np.array([reach]))[0])


def compute_servo_torques(nominal: Nominal, evidence: EpisodeBatch, predicted: np.ndarray, index: int) -> np.ndarray:
    """Return the unlimited torque of a joint's actuator at the predicted positions [N·m; N], shape (E, T).

    A motor gives its command; a servo gives its gain times its error of position or velocity.
    """
    simulator, joint = nominal.simulator(), nominal.joints[index]
    commands, positions, starts = (
        rows[..., index] for rows in (evidence.commands, predicted, evidence.initial_positions)
    )
    kind, gain = simulator.kinds[index], read_servo_stiffness(nominal.spec, joint)
    if kind == EFFORT:
        return commands
    if kind == POSITION:
        return (gain or read_controller_stiffness(simulator.model, joint)) * (commands - positions)
    if gain:  # an integrated-velocity servo
        return gain * (starts[:, None] + np.cumsum(commands, axis=1) * evidence.period - positions)
    speeds = np.diff(positions, axis=1, prepend=starts[:, None]) / evidence.period
    return np.asarray(max(read_servo_damping(nominal.spec, joint), 0.0) * (commands - speeds))


def read_controller_stiffness(model: mujoco.MjModel, joint: str) -> float:
    """Return the torque per position error of a `dcmotor` with a controller [N·m/rad; N/m]."""
    actuator, _ = find_command(model, int(model.joint(joint).id), "the model")
    return read_length_feedback(model, actuator) * float(model.actuator_gear[actuator, 0]) ** 2


def measure_large_speed(evidence: EpisodeBatch, index: int) -> float:
    """Return the 98th percentile of a joint's measured speed over 50 ms [rad/s; m/s]."""
    gap = max(1, round(0.05 / evidence.period))
    moved = np.abs(evidence.measured[:, gap:, index] - evidence.measured[:, :-gap, index])
    return float(np.percentile(moved[evidence.mask[:, gap:]], 98)) / (gap * evidence.period)
