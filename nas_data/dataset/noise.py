"""How noisy and how coarse position readings are, told from the readings alone."""

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

SMALLEST = 1e-5  # [rad] below which no floor makes sense: float32 and solver tolerances
# Of the differences in which noise shows: rounding alone looks like more in even ones; the higher, the less motion
ODD, ORDERS = (3, 5), (4, 5, 6, 8)
NORMAL = 1.4826  # standard deviation over median absolute deviation of a normal distribution
STRETCH, END, FAR = 16, 4, 4.0  # readings in which a joint moves, at either end of them, and how many steps it moves
FEWEST = 50  # such stretches from which noise can be told
ENOUGH = 10  # different repeated readings from which a quantum can be told
MULTIPLES = 1e-3  # how near readings must lie to multiples of a quantum, as a share of it


def noise_of_differences(readings: Sequence[np.ndarray], order: int, step: float = 0.0) -> float:
    """Return the standard deviation of white noise that explains the differences of an order [rad].

    Of readings that come in steps only those count that lie within motion, where there are any: noise hides in a joint
    that stands still. Motion is told over a longer stretch, so that it is not the noise that chooses.

    Args:
        readings: Episodes, shape (T,) each.
        order: Of the differences.
        step: Resolution of the readings [rad]; 0 for exact ones.

    Returns:
        The deviation; infinite where no episode is long enough to tell.
    """
    sizes = np.abs(np.concatenate([np.diff(row, order) for row in readings]))
    if step:
        long = [sliding_window_view(row, STRETCH) for row in readings if len(row) >= STRETCH]
        stretches = np.concatenate([np.empty((0, STRETCH)), *long])
        moved = np.abs(stretches[:, -END:].mean(axis=1) - stretches[:, :END].mean(axis=1)) > FAR * step
        if moved.sum() >= FEWEST:
            first = (STRETCH - order) // 2
            sizes = np.abs(np.diff(stretches[moved, first : first + order + 1], order, axis=1)[:, 0])
    if not len(sizes):
        return float(np.inf)
    return NORMAL * median(sizes, step) / float(np.sqrt(comb(2 * order, order)))


def median(sizes: np.ndarray, step: float) -> float:
    """Return the median of sizes that come in steps, as if each were spread evenly over the step that it stands for.

    The plain one jumps from step to step, and a floor that is a multiple of the resolution may be a third off.
    """
    if step == 0.0:
        return float(np.median(sizes))
    edges = np.concatenate([[0.0], (np.arange(sizes.max() / step + 1.0) + 0.5) * step])
    below = np.searchsorted(np.sort(sizes), edges) / len(sizes)
    index = int(np.searchsorted(below, 0.5))
    low, high = below[index - 1], below[index]
    return float(edges[index - 1] + (0.5 - low) / (high - low) * (edges[index] - edges[index - 1]))


def resolution(readings: Sequence[np.ndarray]) -> float:
    """Return the step in which readings come [rad], 0 for exact ones.

    Resampled logs hold values between the sensor's; those that repeat the one before are the sensor's own. A handful of
    these may lie so far apart that no step shows in them, where it does in all readings.
    """
    plateaus = np.concatenate([row[1:][np.diff(row) == 0] for row in readings])
    step = quantum(plateaus) if len(np.unique(plateaus)) >= ENOUGH else 0.0
    return step or quantum(np.concatenate(readings))


def quantum(readings: np.ndarray) -> float:
    """Return the resolution that readings are multiples of [rad], 0 where there is none that stands out."""
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
