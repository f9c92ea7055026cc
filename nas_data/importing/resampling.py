"""Resampling of a recording to even time steps."""

from dataclasses import replace

import numpy as np

from nas_data.dataset.recording import Recording
from nas_data.importing.map import Resample


def resample(recording: Recording, how: Resample) -> Recording:
    """Resample a recording to even time steps.

    Args:
        recording: Aligned recording; of rows with equal time, the last is used.
        how: Rate [Hz] and method.

    Returns:
        Rows at multiples of 1/rate up to the last recorded time. Positions and velocities are interpolated linearly
        or held, by the method. Commands and signals are held, as a robot holds its last command and a register its
        last value. `rows` is the recorded row at or before each new one.
    """
    last_of_time = np.concatenate([np.diff(recording.time) > 0, [True]])
    once = recording.take(last_of_time)
    # The margin keeps the last step if the duration is a whole number of periods up to rounding.
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
