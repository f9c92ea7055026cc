"""Conditions by which rows are divided: speed, reversal, direction, load, command, saturation, time, limits."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nas_data.gap.finding.loads import Loads
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.simulators.layout import find_joint_index

REVERSAL_SECONDS = 0.2  # [s] after a reversal
LIMIT_SHARE = 0.05  # share of a joint's range near each limit
SMALLEST_LOAD = 1e-4  # [N·m] smallest difference between light and heavy postures


@dataclass(frozen=True)
class ConditionInputs:
    """Input of conditions.

    Attributes:
        recorded: Rows of E episodes, T rows, n joints.
        loads: The model's torques in these rows.
        nominal: Model.
        floor: Noise floor [rad; m], shape (n,).
    """

    recorded: RecordedRows
    loads: Loads
    nominal: Nominal
    floor: np.ndarray


@dataclass(frozen=True)
class Condition:
    """A division of the rows into bins.

    Attributes:
        name: Name of the condition.
        bins: Names of the bins.
        labels: Index of each row's bin, −1 for none, shape (E, T, n).
        whole_episodes: Whether all rows of an episode are in one bin.
    """

    name: str
    bins: tuple[str, ...]
    labels: np.ndarray
    whole_episodes: bool = False


def list_conditions(setting: ConditionInputs) -> tuple[Condition, ...]:
    """Return every condition; rows that were not recorded are in no bin."""
    counts = setting.recorded.evidence.mask[..., None]
    found = (make(setting) for make in CONDITIONS)
    return tuple(Condition(c.name, c.bins, np.where(counts, c.labels, -1), c.whole_episodes) for c in found)


def bin_by_speed(setting: ConditionInputs) -> Condition:
    """Divide rows into rest and terciles of speed."""
    moving = setting.recorded.moving(setting.floor)
    thirds = divide_into_thirds(np.abs(setting.recorded.motion), moving)
    return Condition(
        "speed", ("still", "slow", "medium", "fast"), np.where(moving, np.where(thirds < 0, -1, thirds + 1), 0)
    )


def bin_by_reversal(setting: ConditionInputs) -> Condition:
    """Divide rows by whether the direction of motion changed shortly before."""
    sign = find_last_direction(setting)
    turned = np.zeros(sign.shape, bool)
    turned[:, 1:] = sign[:, 1:] * sign[:, :-1] < 0
    rows = max(1, round(REVERSAL_SECONDS / setting.nominal.period))
    total = np.cumsum(turned, axis=1)
    earlier = np.pad(total, ((0, 0), (rows, 0), (0, 0)))[:, : total.shape[1]]
    return Condition("reversal", ("other times", "after a reversal"), np.where(sign == 0, -1, total > earlier))


def bin_by_direction(setting: ConditionInputs) -> Condition:
    """Divide rows in motion by sign."""
    moving = setting.recorded.moving(setting.floor)
    return Condition("direction", ("negative", "positive"), np.where(moving, setting.recorded.motion > 0, -1))


def bin_by_load(setting: ConditionInputs) -> Condition:
    """Divide rows by the torque of the posture; joints without gravity loads are in no bin."""
    size = np.abs(setting.loads.posture)
    labels = divide_into_thirds(size, setting.recorded.evidence.mask[..., None], SMALLEST_LOAD)
    return Condition("load", ("light", "medium", "heavy"), labels)


def bin_by_command_size(setting: ConditionInputs) -> Condition:
    """Divide rows by position error of the servo, or by the size of other commands."""
    evidence = setting.recorded.evidence
    positional = setting.nominal.simulator().layout.inputs.positional
    size = np.abs(evidence.commands - np.where(positional, setting.recorded.positions, 0.0))
    return Condition("command size", ("small", "medium", "large"), divide_into_thirds(size, evidence.mask[..., None]))


def bin_by_saturation(setting: ConditionInputs) -> Condition:
    """Divide rows by whether the model's servo is at its torque limit."""
    labels = np.where(setting.loads.limited, setting.loads.saturated, -1)
    return Condition("saturation", ("below the limit", "at the limit"), labels)


def bin_by_recording_time(setting: ConditionInputs) -> Condition:
    """Divide episodes by their order in the recording, to show drift."""
    episodes, steps, n = setting.recorded.positions.shape
    third = np.arange(episodes) * 3 // max(episodes, 3)
    labels = np.broadcast_to(third[:, None, None], (episodes, steps, n))
    return Condition("recording time", ("first third", "middle", "last third"), labels, whole_episodes=True)


def bin_by_joint_limits(setting: ConditionInputs) -> Condition:
    """Divide rows by whether the joint is near the end of its range."""
    model = setting.nominal.simulator().model
    labels = np.full(setting.recorded.positions.shape, -1)
    for column, name in enumerate(setting.nominal.joints):
        joint = find_joint_index(model, name, name)
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
            room = np.minimum(
                setting.recorded.positions[..., column] - low, high - setting.recorded.positions[..., column]
            )
            labels[..., column] = room < LIMIT_SHARE * (high - low)
    return Condition("joint limits", ("away", "near"), labels)


CONDITIONS: tuple[Callable[[ConditionInputs], Condition], ...] = (
    bin_by_speed,
    bin_by_reversal,
    bin_by_direction,
    bin_by_load,
    bin_by_command_size,
    bin_by_saturation,
    bin_by_recording_time,
    bin_by_joint_limits,
)


def divide_into_thirds(sizes: np.ndarray, chosen: np.ndarray, apart: float = 1e-9) -> np.ndarray:
    """Return terciles 0, 1, 2 of the chosen rows of each joint, −1 for other rows and for terciles that coincide.

    Args:
        sizes: Values, shape (E, T, n).
        chosen: Rows that are divided, shape (E, T, n) or (E, T, 1).
        apart: Smallest width of the middle tercile.
    """
    chosen = np.broadcast_to(chosen, sizes.shape)
    labels = np.full(sizes.shape, -1)
    for joint in range(sizes.shape[-1]):
        rows = chosen[..., joint]
        if rows.sum() < 3:
            continue
        low, high = np.quantile(sizes[..., joint][rows], (1 / 3, 2 / 3))
        if high - low > apart:
            labels[..., joint][rows] = np.digitize(sizes[..., joint][rows], (low, high))
    return labels


def find_last_direction(setting: ConditionInputs) -> np.ndarray:
    """Return the sign of each joint's last motion up to each row, 0 before the first; shape (E, T, n)."""
    moving = setting.recorded.moving(setting.floor)
    rows = np.arange(moving.shape[1])[None, :, None]
    latest = np.maximum.accumulate(np.where(moving, rows, -1), axis=1)
    sign = np.take_along_axis(np.sign(setting.recorded.motion), np.maximum(latest, 0), axis=1)
    return np.where(latest < 0, 0, sign)
