"""Roll a source out over whole episodes, in batches."""

from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.pairing import check_fits, initial_states
from nas_data.simulators.base import Simulator

ROLLOUT_BATCH = 64
SHORTEST = 0.8  # of the longest rollout in a batch of the source: what is padded is simulated, too, and thrown away


def open_loop_source(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Roll the source out over every episode, started at its first measured state; a list of (T, 2n)."""
    return [states[:, : dataset.states.shape[1]] for states in open_loop_scene(dataset, simulator)]


def open_loop_scene(dataset: Dataset, simulator: Simulator) -> list[np.ndarray]:
    """Do as `open_loop_source`, with the objects that the dataset has: a list of (T, 2n or 2n + m)."""
    check_fits(dataset, simulator)
    initial = initial_states(dataset, simulator)
    result: list[np.ndarray] = [np.empty(0)] * dataset.n_episodes
    for batch in like_lengths(dataset.lengths):
        commands = padded_commands(dataset, batch)
        states = simulator.rollout_settled(initial[batch], commands)
        for row, episode in enumerate(batch):
            result[episode] = states[row, : dataset.lengths[episode]]
    return result


def batches(lengths: np.ndarray, ordered: bool = True) -> list[list[int]]:
    """Group episodes for batched rollouts, those of like length together where `ordered`."""
    order = np.argsort(-lengths, kind="stable") if ordered else np.arange(len(lengths))
    return [order[start : start + ROLLOUT_BATCH].tolist() for start in range(0, len(order), ROLLOUT_BATCH)]


def like_lengths(lengths: np.ndarray) -> list[list[int]]:
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


def padded_commands(dataset: Dataset, episodes: Sequence[int]) -> np.ndarray:
    """Return the commands of episodes, shorter ones padded by their last, shape (B, T, n), float64."""
    longest = int(dataset.lengths[list(episodes)].max())
    rows = [dataset.commands[dataset.episode(episode)] for episode in episodes]
    return np.stack([np.pad(row, ((0, longest - len(row)), (0, 0)), mode="edge") for row in rows]).astype(float)
