"""The noise floor: the smallest error that any model can have on quantised, noisy readings."""

from collections.abc import Sequence
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from nas_data.dataset.dataset import Dataset
from nas_data.pairing import scene_states
from nas_data.simulators.base import Simulator

if TYPE_CHECKING:
    from nas_data.gap.evidence import Evidence

SMALLEST = 1e-5  # [rad] below which no floor makes sense: float32 and solver tolerances
# Of the differences in which noise shows: rounding alone looks like more in even ones; the higher, the less motion
ODD, ORDERS = (3, 5), (4, 5, 6, 8)
COARSE = 2.0  # [roundings] up to which noise is what odd differences say; beyond, it might be motion
STEPS = 4000  # transitions of which a model's errors after one step are taken at most
NORMAL = 1.4826  # standard deviation over median absolute deviation of a normal distribution
STRETCH, END, FAR = 16, 4, 4.0  # readings in which a joint moves, at either end of them, and how many steps it moves
FEWEST = 50  # such stretches from which noise can be told
ENOUGH = 10  # different repeated readings from which a quantum can be told
MULTIPLES = 1e-3  # how near readings must lie to multiples of a quantum, as a share of it


def noise_floor(evidence: "Evidence", most: np.ndarray | None = None) -> np.ndarray:
    """Estimate the standard deviation of the position readings' error [rad], shape (n,).

    A quantum Δ gives Δ/√12. Noise beyond it shows in high differences, in which smooth motion hardly does; rounding
    noise in a still joint does not show at all, hence the larger of both counts. What looks like much more noise than
    rounding may be fast motion: it is noise only as far as higher differences show it too, and the error of a model's
    single steps, in which all noise of the reading that follows is.

    Args:
        evidence: Readings.
        most: Error of single steps [rad], shape (n,); see `step_errors`.
    """
    limits = np.full(len(evidence.joints), np.inf) if most is None else most
    return np.array([joint_floor(evidence, joint, float(limit)) for joint, limit in enumerate(limits)])


def step_errors(dataset: Dataset, simulator: Simulator) -> np.ndarray:
    """Return the standard deviation of normal noise that explains a model's errors after one step [rad], shape (n,).

    However wrong the model is, noise is not larger: what it gets wrong only adds to that.
    """
    rows = np.unique(np.linspace(0, dataset.n_frames - 1, STEPS).round().astype(int))
    predicted = simulator.predict(
        scene_states(dataset, simulator, rows).astype(float), dataset.commands[rows].astype(float)
    )
    n = len(dataset.joints)
    errors = np.abs(predicted[:, :n] - dataset.next_states[rows, :n])
    return NORMAL * np.median(np.where(np.isfinite(errors), errors, np.inf), axis=0)


def joint_floor(evidence: "Evidence", joint: int, most: float) -> float:
    """Return the floor of one joint [rad], given what it is at most beyond a few roundings."""
    readings = [row[seen, joint] for row, seen in zip(evidence.measured, evidence.counts, strict=True)]
    step = resolution(readings)
    rounding = step / np.sqrt(12.0)
    noise = min(spread(readings, order, step) for order in ODD)
    if noise > COARSE * rounding:
        noise = max(COARSE * rounding, min(noise, most, *(spread(readings, order, step) for order in ORDERS)))
    return max(rounding, noise, SMALLEST)


def spread(readings: Sequence[np.ndarray], order: int, step: float = 0.0) -> float:
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
    place = int(np.searchsorted(below, 0.5))
    low, high = below[place - 1], below[place]
    return float(edges[place - 1] + (0.5 - low) / (high - low) * (edges[place] - edges[place - 1]))


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


def ratios(squares: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Return errors over the floor, the geometric mean over episodes, from mean squares (E, n): shape (n,).

    One episode that went astray does not rule, as it would a mean, nor is it overlooked, as a median would.
    """
    return np.asarray(np.exp(0.5 * np.log(np.maximum(squares, 1e-300)).mean(axis=0)) / floor)
