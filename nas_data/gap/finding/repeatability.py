"""Repeatability: difference between repeats of the same commands, which no model of the commands explains."""

from collections import defaultdict

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch

SAME_START = 4.0  # noise floors within which repeats must start


def measure_repeatability(evidence: EpisodeBatch, floor: np.ndarray) -> np.ndarray | None:
    """Return the standard deviation between repeats of the same commands [rad; m], shape (n,); None without repeats."""
    squares, freedom = np.zeros(len(floor)), 0
    for group in find_repeats(evidence, floor):
        counts = evidence.mask[group[0]]
        measured = evidence.measured[group][:, counts]
        squares += ((measured - measured.mean(0)) ** 2).sum((0, 1))
        freedom += (len(group) - 1) * int(counts.sum())
    return np.sqrt(squares / freedom) if freedom else None


def find_repeats(evidence: EpisodeBatch, floor: np.ndarray) -> list[list[int]]:
    """Return groups of episodes with the same commands and initial pose."""
    groups: dict[bytes, list[int]] = defaultdict(list)
    for episode in range(len(evidence)):
        rows = evidence.commands[episode, evidence.mask[episode]]
        groups[rows.astype(np.float32).tobytes()].append(episode)
    found = []
    for group in groups.values():
        middle = np.median(evidence.initial_positions[group], axis=0)
        near = [
            episode
            for episode in group
            if (np.abs(evidence.initial_positions[episode] - middle) <= SAME_START * floor).all()
        ]
        if len(near) > 1:
            found.append(near)
    return found
