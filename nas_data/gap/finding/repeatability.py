"""How alike repeats of the same commands came out: what no model that is told the commands can explain."""

from collections import defaultdict

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch

SAME_START = 4.0  # noise floors within which repeats must start; else their paths differ for a known reason


def measure_repeatability(evidence: EpisodeBatch, floor: np.ndarray) -> np.ndarray | None:
    """Return the standard deviation between repeats of the same commands [rad], shape (n,); None without repeats."""
    squares, freedom = np.zeros(len(floor)), 0
    for group in find_repeats(evidence, floor):
        counts = evidence.mask[group[0]]
        measured = evidence.measured[group][:, counts]
        squares += ((measured - measured.mean(0)) ** 2).sum((0, 1))
        freedom += (len(group) - 1) * int(counts.sum())
    return np.sqrt(squares / freedom) if freedom else None


def find_repeats(evidence: EpisodeBatch, floor: np.ndarray) -> list[list[int]]:
    """Return groups of episodes that were given the same commands from the same pose."""
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
