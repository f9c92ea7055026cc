"""Resampling of a recording to even steps; only where the map asks for it."""

from dataclasses import replace

import numpy as np

from nas_data.dataset.recording import Recording
from nas_data.importing.map import Resample


def resample(recording: Recording, how: Resample) -> Recording:
    """Space the rows evenly.

    Args:
        recording: Aligned recording; of rows with the same time the last counts.
        how: Rate [Hz] and method.

    Returns:
        Rows at multiples of 1/rate up to the last recorded time. Positions and velocities are interpolated linearly
        or held, as the method says; commands and signals are held, because a robot holds its last command and a
        register its last value. `rows` is the recorded row at or before each new one.
    """
    last_of_time = np.concatenate([np.diff(recording.time) > 0, [True]])
    once = recording.take(last_of_time)
    # A hair more than the end, so that a whole number of periods is not lost to rounding.
    count = int(np.floor(once.time[-1] * how.rate + 1e-6)) + 1
    grid = np.arange(count) / how.rate
    held = np.clip(np.searchsorted(once.time, grid + 1e-9, side="right") - 1, 0, None)

    def between(values: np.ndarray) -> np.ndarray:
        if how.method == "previous":
            return values[held]
        return np.column_stack([np.interp(grid, once.time, column) for column in values.T])

    return replace(
        once,
        time=grid,
        positions=between(once.positions),
        velocities=None if once.velocities is None else between(once.velocities),
        commands=once.commands[held],
        signals={key: values[held] for key, values in once.signals.items()},
        rows=once.rows[held],
    )
