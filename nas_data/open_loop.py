"""Roll a source out over whole episodes, in batches."""

from collections.abc import Callable, Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import VELOCITY
from nas_data.pairing import check_fits, read_initial_states
from nas_data.simulators.base import Simulator

ROLLOUT_BATCH = 64
SHORTEST = 0.8  # of the longest rollout in a batch of the source: what is padded is simulated, too, and thrown away


def roll_out_source(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Roll the source out over every episode, started at its first measured state; a list of (T, 2n)."""
    return [states[:, : dataset.states.shape[1]] for states in roll_out_scene(dataset, simulator)]


def roll_out_scene(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Do as `roll_out_source`, with the objects that the dataset has: a list of (T, 2n or 2n + m)."""
    check_fits(dataset, simulator)
    initial = read_initial_states(dataset, simulator)
    settled = roll_out_episodes(dataset, initial, simulator.rollout_settled)
    if not has_setpoints(simulator):
        return settled
    fresh = roll_out_episodes(dataset, initial, simulator.rollout)
    return min(settled, fresh, key=lambda states: compute_position_misfit(dataset, states))


def roll_out_episodes(
    dataset: Dataset, initial: np.ndarray, rollout: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> list[np.ndarray]:
    """Roll out every episode from its initial state (E, 2n or 2n + m); a list of (T, 2n or 2n + m)."""
    result: list[np.ndarray] = [np.empty(0)] * dataset.n_episodes
    for batch in group_by_length(dataset.lengths):
        states = rollout(initial[batch], pad_commands(dataset, batch))
        for row, episode in enumerate(batch):
            result[episode] = states[row, : dataset.lengths[episode]]
    return result


def has_setpoints(simulator: Simulator) -> bool:
    """Whether velocity commands move setpoints, whose start is not measured.

    They may start ahead of their joints, where the servos hold the arm's weight, or at them, as after a reset.
    """
    return simulator.remembers and VELOCITY in simulator.kinds


def compute_position_misfit(dataset: Dataset, states: Sequence[np.ndarray]) -> float:
    """Return the sum over joints of the logarithms of their mean squared position errors."""
    n = len(dataset.joints)
    errors = (
        np.concatenate(states)[:, :n]
        - np.concatenate([dataset.next_states[rows] for rows in dataset.episodes()])[:, :n]
    )
    return float(np.log(np.square(errors).mean(0) + np.finfo(float).tiny).sum())


def make_batches(lengths: np.ndarray, ordered: bool = True) -> list[list[int]]:
    """Group episodes for batched rollouts, those of like length together where `ordered`."""
    order = np.argsort(-lengths, kind="stable") if ordered else np.arange(len(lengths))
    return [order[start : start + ROLLOUT_BATCH].tolist() for start in range(0, len(order), ROLLOUT_BATCH)]


def group_by_length(lengths: np.ndarray) -> list[list[int]]:
    """Group episodes for rollouts of the source, longest first, so that little is padded.

    A model's rollouts are not grouped so: a step of them costs nearly the same for any number of episodes.
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
    """Return the commands of episodes, shorter ones padded by their last, shape (B, T, n), float64."""
    longest = int(dataset.lengths[list(episodes)].max())
    rows = [dataset.commands[dataset.episode(episode)] for episode in episodes]
    return np.stack([np.pad(row, ((0, longest - len(row)), (0, 0)), mode="edge") for row in rows]).astype(float)
