"""Open-loop rollouts of the source over whole episodes, in batches."""

from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.start_velocities import find_start_velocities
from nas_data.dataset.torque_off import find_shutdowns
from nas_data.pairing import check_fits, read_initial_states
from nas_data.simulators.base import Simulator
from nas_data.simulators.initial_states import START_SECONDS, InitialLoad, choose_initial_loads
from nas_data.simulators.mujoco import MujocoSimulator

ROLLOUT_BATCH = 64
SHORTEST = 0.8  # shortest over longest rollout in a batch: shorter ones are padded, which wastes simulation


def roll_out_source(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Roll the source out over every episode from its first measured state; a list of (T, 2n)."""
    return [states[:, : dataset.states.shape[1]] for states in roll_out_scene(dataset, simulator)]


def roll_out_scene(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Roll out as `roll_out_source`, including the dataset's objects; a list of (T, 2n or 2n + m).

    Where the recording's torque is first off, MuJoCo's servos are switched off for the rest of the episode.
    """
    check_fits(dataset, simulator)
    initial, commands = read_initial_states(dataset, simulator), [dataset.commands[rows] for rows in dataset.episodes()]
    loads = infer_initial_loads(dataset, simulator, initial) if simulator.remembers else None
    return roll_out_episodes(simulator, initial, commands, loads, find_shutdowns(dataset))


def infer_initial_loads(dataset: Dataset, simulator: Simulator, initial: np.ndarray) -> np.ndarray:
    """Return the `InitialLoad` of each joint that fits the first second of each episode best, shape (E, n).

    Args:
        dataset: Episodes.
        simulator: Source with unmeasured state, such as play or a setpoint.
        initial: First state of each episode, shape (E, 2n or 2n + m).
    """
    n, rows = len(dataset.joints), max(1, round(START_SECONDS * dataset.fps))
    slices = [slice(part.start, min(part.stop, part.start + rows)) for part in dataset.episodes()]
    commands, measured = ([values[part] for part in slices] for values in (dataset.commands, dataset.next_states))
    squares = np.empty((len(InitialLoad), dataset.n_episodes, n))
    for load in InitialLoad:
        rolled = roll_out_episodes(simulator, initial, commands, np.full((dataset.n_episodes, n), load))
        for episode, (states, reached) in enumerate(zip(rolled, measured, strict=True)):
            squares[load, episode] = np.square(states[:, :n] - reached[:, :n]).mean(0)
    return choose_initial_loads(squares, find_start_velocities(dataset).noise)


def roll_out_episodes(
    simulator: Simulator,
    initial: np.ndarray,
    commands: Sequence[np.ndarray],
    loads: np.ndarray | None,
    torque_off_from: np.ndarray | None = None,
) -> list[np.ndarray]:
    """Roll out every episode from its initial state; a list of (T, 2n or 2n + m).

    Args:
        simulator: Source.
        initial: First states, shape (E, 2n or 2n + m).
        commands: Commands of each episode, shape (T, n).
        loads: Initial load of each joint (an `InitialLoad`), shape (E, n); the arm's weight if None.
        torque_off_from: Control steps after which MuJoCo's servos are switched off, shape (E,); never if None.
    """
    lengths = np.array([len(rows) for rows in commands])
    result: list[np.ndarray] = [np.empty(0)] * len(commands)
    for batch in group_by_length(lengths):
        held = None if loads is None else loads[batch]
        start = initial[batch], stack_padded([commands[row] for row in batch]), held
        if torque_off_from is not None and isinstance(simulator, MujocoSimulator):
            states = simulator.rollout_settled(*start, torque_off_from[batch])
        else:
            states = simulator.rollout_settled(*start)
        for row, episode in enumerate(batch):
            result[episode] = states[row, : lengths[episode]]
    return result


def make_batches(lengths: np.ndarray, ordered: bool = True) -> list[list[int]]:
    """Group episodes for batched rollouts; episodes of similar length share a batch if `ordered`."""
    order = np.argsort(-lengths, kind="stable") if ordered else np.arange(len(lengths))
    return [order[start : start + ROLLOUT_BATCH].tolist() for start in range(0, len(order), ROLLOUT_BATCH)]


def group_by_length(lengths: np.ndarray) -> list[list[int]]:
    """Group episodes for rollouts of the source, longest first, to keep padding small.

    Learned models are not grouped: their cost per step hardly depends on the batch size.
    """
    groups: list[list[int]] = []
    for episode in np.argsort(-lengths, kind="stable").tolist():
        fits = bool(groups) and len(groups[-1]) < ROLLOUT_BATCH
        if fits and lengths[episode] >= SHORTEST * lengths[groups[-1][0]]:
            groups[-1].append(episode)
        else:
            groups.append([episode])
    return groups


def pad_commands(dataset: Dataset, episodes: Sequence[int]) -> np.ndarray:
    """Return the commands of episodes, shorter ones padded with their last command, shape (B, T, n), float64."""
    return stack_padded([dataset.commands[dataset.episode(episode)] for episode in episodes])


def stack_padded(commands: Sequence[np.ndarray]) -> np.ndarray:
    """Stack commands (T, n) of several episodes, shorter ones padded with their last, shape (B, T, n), float64."""
    longest = max(len(rows) for rows in commands)
    return np.stack([np.pad(rows, ((0, longest - len(rows)), (0, 0)), mode="edge") for rows in commands]).astype(float)
