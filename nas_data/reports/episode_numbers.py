"""What is looked at in every episode of a dataset, and which episodes differ from the others."""

from collections.abc import Mapping, Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.timing import LATE

OUTLYING = 4.0  # median absolute deviations of all episodes from which one is worth a look


def measure_steps(dataset: Dataset) -> list[np.ndarray]:
    """Return the steps of the recorder's clock in each episode [s], shape (T − 1,) each; empty without a clock."""
    clock = dataset.columns.get(TIME)
    return [] if clock is None else [np.diff(clock[rows, 0]) for rows in dataset.episodes()]


def measure_episodes(dataset: Dataset, steps: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return what is looked at in every episode, by its name in tables, shape (E,) each.

    That is its length; the largest range and the largest speed of a joint, as shares of those in the whole dataset;
    where commands are positions, the RMS of command minus position, each joint's over its range in the dataset; with a
    clock, the share of steps that are off by more than `LATE` control periods.

    Args:
        dataset: E episodes.
        steps: Of the clock, as from `measure_steps`.
    """
    n, period = len(dataset.joints), 1 / dataset.fps
    positions, speeds = dataset.states[:, :n], np.abs(dataset.states[:, n : 2 * n])
    ranges, fastest = np.maximum(np.ptp(positions, axis=0), 1e-9), np.maximum(speeds.max(axis=0), 1e-9)
    episodes = list(dataset.episodes())
    measured = {
        "length [s]": dataset.lengths * period,
        "travel": np.array([float((np.ptp(positions[rows], axis=0) / ranges).max()) for rows in episodes]),
        "top speed": np.array([float((speeds[rows] / fastest).max()) for rows in episodes]),
    }
    if dataset.positional.any() and dataset.commands.shape[1] == n:
        errors = np.square((dataset.commands - positions) / ranges)[:, dataset.positional]
        measured["command − position"] = np.array([np.sqrt(errors[rows].mean()) for rows in episodes])
    if steps:
        late = [float((np.abs(part - period) > LATE * period).mean()) if len(part) else 0.0 for part in steps]
        measured["uneven steps"] = np.array(late)
    return {name: values for name, values in measured.items() if np.isfinite(values).all()}


def find_differing(measured: Mapping[str, np.ndarray]) -> dict[int, list[str]]:
    """Return the episodes that differ from the others, the most striking first, and in what."""
    found: dict[int, list[str]] = {}
    strength: dict[int, float] = {}
    for name, values in measured.items():
        middle = float(np.median(values))
        scale = max(1.4826 * float(np.median(np.abs(values - middle))), 0.05 * abs(middle), 1e-3)
        for episode in np.flatnonzero(np.abs(values - middle) > OUTLYING * scale):
            direction = "high" if values[episode] > middle else "low"
            found.setdefault(int(episode), []).append(f"{direction} {name.partition(' [')[0]}")
            far = float(abs(values[episode] - middle) / scale)
            strength[int(episode)] = max(strength.get(int(episode), 0.0), far)
    return {episode: found[episode] for episode in sorted(found, key=lambda episode: -strength[episode])}
