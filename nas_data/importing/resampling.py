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
        or held, by the method. A new row has the command that was held in the middle of its step, and the signals of
        that recorded row, which `rows` tells.
    """
    once = take_last_of_time(recording)
    # The margin keeps the last step if the duration is a whole number of periods up to rounding.
    count = int(np.floor(once.time[-1] * how.rate + 1e-6)) + 1
    grid = np.arange(count) / how.rate
    last = _find_last_row(once.time, grid + 1e-9)
    # A command acts from its row to the next. At the start of a step, a clock that jitters by microseconds decides
    # between two commands. The command of the middle is right there, and neither early nor late on average elsewhere.
    acting = _find_last_row(once.time, grid + 0.5 / how.rate - 1e-9)

    def between(values: np.ndarray) -> np.ndarray:
        if how.method == "previous":
            return values[last]
        return np.column_stack([np.interp(grid, once.time, column) for column in values.T])

    return replace(
        once,
        time=grid,
        positions=between(once.positions),
        velocities=None if once.velocities is None else between(once.velocities),
        commands=once.commands[acting],
        signals={key: values[acting] for key, values in once.signals.items()},
        rows=once.rows[acting],
    )


def take_last_of_time(recording: Recording) -> Recording:
    """Return a recording with the last row of each time only, which resampling uses."""
    return recording.take(np.concatenate([np.diff(recording.time) > 0, [True]]))


def _find_last_row(time: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Find the last row at or before each moment [s]; the first row where there is none before."""
    return np.clip(np.searchsorted(time, moments, side="right") - 1, 0, None)
