"""Estimates of noise and resolution of position readings, from the readings alone."""

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

SMALLEST = 1e-5  # [rad] smallest meaningful floor: float32 and solver tolerances
# Orders of the differences that show noise: rounding alone looks larger in even orders; higher orders contain less
# motion.
ODD, ORDERS = (3, 5), (4, 5, 6, 8)
DEVIATION_PER_MAD = 1.4826  # standard deviation over median absolute deviation of a normal distribution
STRETCH, END, FAR = 16, 4, 4.0  # readings of a stretch in motion, at either end of it, and its smallest motion [steps]
MIN_STRETCHES = 50  # fewest such stretches to estimate noise
MIN_READINGS = 10  # fewest different repeated readings to estimate a quantum
MULTIPLES = 1e-3  # largest distance of readings from multiples of a quantum, as a share of it


def estimate_noise(readings: Sequence[np.ndarray], order: int, step: float = 0.0) -> float:
    """Return the standard deviation of the white noise that explains the differences of a given order [rad].

    Quantised readings count only during motion, if there is any, because rounding hides the noise of a joint at rest.
    Motion is detected over a longer window, so that noise does not select the readings.

    Args:
        readings: Positions of one joint [rad], one array of shape (T,) per episode.
        order: Order of the differences.
        step: Resolution of the readings [rad]; 0 for exact ones.

    Returns:
        The standard deviation; infinite if no episode is long enough.
    """
    sizes = np.abs(np.concatenate([np.diff(row, order) for row in readings]))
    if step:
        long = [sliding_window_view(row, STRETCH) for row in readings if len(row) >= STRETCH]
        stretches = np.concatenate([np.empty((0, STRETCH)), *long])
        moved = np.abs(stretches[:, -END:].mean(axis=1) - stretches[:, :END].mean(axis=1)) > FAR * step
        if moved.sum() >= MIN_STRETCHES:
            first = (STRETCH - order) // 2
            sizes = np.abs(np.diff(stretches[moved, first : first + order + 1], order, axis=1)[:, 0])
    if not len(sizes):
        return float(np.inf)
    return DEVIATION_PER_MAD * median(sizes, step) / float(np.sqrt(comb(2 * order, order)))


def median(sizes: np.ndarray, step: float) -> float:
    """Return the median of quantised values, each spread evenly over its quantisation step.

    The plain median jumps between steps: a noise floor near the resolution could be off by a third.
    """
    if step == 0.0:
        return float(np.median(sizes))
    edges = np.concatenate([[0.0], (np.arange(sizes.max() / step + 1.0) + 0.5) * step])
    below = np.searchsorted(np.sort(sizes), edges) / len(sizes)
    index = int(np.searchsorted(below, 0.5))
    low, high = below[index - 1], below[index]
    return float(edges[index - 1] + (0.5 - low) / (high - low) * (edges[index] - edges[index - 1]))


def estimate_resolution(readings: Sequence[np.ndarray]) -> float:
    """Return the quantisation step of readings [rad], 0 if there is none.

    Resampled logs hold interpolated values; only repeated values are certain to be the sensor's own. If these are too
    few to show a step, all readings are used.
    """
    plateaus = np.concatenate([row[1:][np.diff(row) == 0] for row in readings])
    step = find_quantisation_step(plateaus) if len(np.unique(plateaus)) >= MIN_READINGS else 0.0
    return step or find_quantisation_step(np.concatenate(readings))


def find_quantisation_step(readings: np.ndarray) -> float:
    """Return the largest clear step that all readings are multiples of [rad]; 0 if there is none."""
    values = np.unique(readings)
    if len(values) < 3:
        return 0.0
    steps = np.diff(values)
    step = float(np.median(steps[steps < 1.5 * steps[steps > 1e-6].min()])) if (steps > 1e-6).any() else 0.0
    if step < SMALLEST:
        return 0.0
    origin = values[0]
    counts = np.round((values - origin) / step)
    if counts[-1]:
        step = float((values[-1] - origin) / counts[-1])
    apart = np.abs((values - origin) / step - np.round((values - origin) / step))
    return step if apart.max() < MULTIPLES * 20 and counts[-1] >= 2 else 0.0
