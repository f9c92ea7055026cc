"""Natural sizes at a joint, from which the first guesses of an effect's parameters are made."""

import mujoco
import numpy as np

from nas_data.effects.base import Scales, joint_actuator
from nas_data.effects.edits.servo import damping, stiffness, takes_position
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.robots.base import deepest_joint


def scales(nominal: Nominal, evidence: EpisodeBatch, predicted: np.ndarray) -> tuple[Scales, ...]:
    """Return the scales of every joint.

    Args:
        nominal: The model.
        evidence: What was measured.
        predicted: The model's positions for it, shape (E, T, n).
    """
    model = nominal.simulator().model
    moved = {p.joint: p.bodies for p in nominal.base if p.kind == "mass"}
    outermost = moved[deepest_joint(nominal.spec, tuple(moved))] if moved else ()
    last = sum(float(nominal.spec.body(name).mass) for name in outermost) or 0.01
    return tuple(joint_scales(nominal, model, evidence, predicted, index, last) for index in range(len(nominal.joints)))


def joint_scales(
    nominal: Nominal, model: mujoco.MjModel, evidence: EpisodeBatch, predicted: np.ndarray, index: int, mass: float
) -> Scales:
    """Return the scales of one joint."""
    joint = nominal.joints[index]
    actuator = joint_actuator(nominal.spec, joint)
    element = nominal.spec.joint(joint)
    gain = stiffness(nominal.spec, joint)
    losses = float(element.damping[0]) + max(damping(nominal.spec, joint), 0.0)
    inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
    speed = large_speed(evidence, index)
    if gain > 0 and takes_position(actuator):
        ranges = (actuator.forcerange * float(actuator.gear[0]), element.actfrcrange)
        limit = min(float(np.abs(each).max()) or np.inf for each in ranges)
        errors = np.abs(evidence.commands[..., index] - predicted[..., index])[evidence.counts]
        torque = min(limit, gain * float(np.percentile(errors, 98)))
    else:
        torque = float(np.percentile(np.abs(evidence.commands[..., index]), 98))
    return Scales(gain or max(torque, 1e-4), losses, inertia, mass, max(torque, 1e-4), max(speed, 1e-2))


def large_speed(evidence: EpisodeBatch, index: int) -> float:
    """Return the 98th percentile of a joint's measured speed over 50 ms [rad/s]."""
    gap = max(1, round(0.05 / evidence.period))
    moved = np.abs(evidence.measured[:, gap:, index] - evidence.measured[:, :-gap, index])
    return float(np.percentile(moved[evidence.counts[:, gap:]], 98)) / (gap * evidence.period)
