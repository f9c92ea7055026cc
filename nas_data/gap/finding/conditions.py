"""Conditions by which rows are divided: speed, reversal, direction, load, command, saturation, time, limits."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.simulators.layout import FULLPHYSICS, find_actuator_index, find_joint_index
from nas_data.simulators.mujoco import MujocoSimulator

AT_LIMIT = 1 - 1e-6  # share of the limit above which a servo is saturated


@dataclass(frozen=True)
class Loads:
    """Torques of n joints in E episodes of up to T rows."""

    posture: np.ndarray  # gravity and Coriolis torque of each joint [N·m; N], shape (E, T, n)
    saturated: np.ndarray  # whether the model's actuator is at its limit, shape (E, T, n)
    limited: np.ndarray  # whether a joint's actuator has a limit, shape (n,)


def find_loads(nominal: Nominal, recorded: RecordedRows) -> Loads:
    """Evaluate the model in every measured state, with the command given there."""
    simulator = nominal.simulator()
    simulator.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    counts = recorded.evidence.mask
    states = np.concatenate([recorded.positions, recorded.motion], axis=-1)[counts]
    posture, force = compute_torques(simulator, states, recorded.evidence.commands[counts])
    low, high = read_torque_limits(simulator)
    saturated = (force <= low * AT_LIMIT) | (force >= high * AT_LIMIT)
    return Loads(scatter_rows(posture, counts), scatter_rows(saturated, counts), np.isfinite(high))


def scatter_rows(rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return values of recorded rows (N, n) at their places (E, T, n), 0 elsewhere."""
    result = np.zeros((*counts.shape, rows.shape[1]), rows.dtype)
    result[counts] = rows
    return result


def compute_torques(
    simulator: MujocoSimulator, states: np.ndarray, commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return load of the posture and actuator torque [N·m; N] for states and commands, shape (N, n) each."""
    model, layout = simulator.model, simulator.layout
    data, followers = mujoco.MjData(model), layout.followers
    full, controls = simulator.rest(states), layout.controls(commands)
    qpos, torques = np.empty((len(states), model.nq)), np.empty((len(states), 2, model.nv))
    for row in range(len(states)):
        mujoco.mj_setState(model, data, full[row], FULLPHYSICS)
        data.ctrl[:] = controls[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        qpos[row], torques[row] = data.qpos, (data.qfrc_bias - data.qfrc_gravcomp, data.qfrc_actuator)
    if followers is not None:  # a shared drive moves them, too
        torques += torques[..., followers.dofs] @ followers.velocity_jacobian(qpos)
    return torques[:, 0, layout.dof], torques[:, 1, layout.dof]


def read_torque_limits(simulator: MujocoSimulator) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest actuator torques at the joints [N·m; N], shape (n,) each."""
    model = simulator.model
    low, high = np.full(len(simulator.joints), -np.inf), np.full(len(simulator.joints), np.inf)
    for row, name in enumerate(simulator.joints):
        joint = find_joint_index(model, name, str(simulator.robot.mjcf))
        actuator = find_actuator_index(model, joint, str(simulator.robot.mjcf))
        ranges = []
        if model.actuator_forcelimited[actuator]:
            ranges.append(np.sort(model.actuator_forcerange[actuator] * model.actuator_gear[actuator, 0]))
        if model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint])
        for lower, upper in ranges:
            low[row], high[row] = max(low[row], lower), min(high[row], upper)
    return low, high


REVERSAL_SECONDS = 0.2  # [s] after a reversal
LIMIT_SHARE = 0.05  # share of a joint's range near each limit
SMALLEST_LOAD = 1e-4  # [N·m] smallest difference between light and heavy postures


@dataclass(frozen=True)
class ConditionInputs:
    """Input of conditions."""

    recorded: RecordedRows  # rows of E episodes, T rows, n joints
    loads: Loads  # the model's torques in these rows
    nominal: Nominal  # model
    floor: np.ndarray  # noise floor [rad; m], shape (n,)


@dataclass(frozen=True)
class Condition:
    """A division of the rows into bins."""

    name: str  # name of the condition
    bins: tuple[str, ...]  # names of the bins
    labels: np.ndarray  # index of each row's bin, −1 for none, shape (E, T, n)
    whole_episodes: bool = False  # whether all rows of an episode are in one bin


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
