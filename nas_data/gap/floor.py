"""The noise floor: the smallest error that any model can have on quantised, noisy readings."""

from typing import TYPE_CHECKING

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.noise import NORMAL, ODD, ORDERS, SMALLEST, noise_of_differences, resolution
from nas_data.pairing import scene_states
from nas_data.simulators.base import Simulator

if TYPE_CHECKING:
    from nas_data.gap.episode_batch import EpisodeBatch

CLOSEST = 3e-4  # share of its travel to which a joint is predicted at best: no simulator follows nature closer
COARSE = 2.0  # [roundings] up to which noise is what odd differences say; beyond, it might be motion
STEPS = 4000  # transitions of which a model's errors after one step are taken at most


def noise_floor(evidence: "EpisodeBatch", most: np.ndarray | None = None) -> np.ndarray:
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


def joint_floor(evidence: "EpisodeBatch", joint: int, most: float) -> float:
    """Return the floor of one joint [rad], given what it is at most beyond a few roundings."""
    readings = [row[seen, joint] for row, seen in zip(evidence.measured, evidence.mask, strict=True)]
    step = resolution(readings)
    rounding = step / np.sqrt(12.0)
    noise = min(noise_of_differences(readings, order, step) for order in ODD)
    if noise > COARSE * rounding:
        noise = max(
            COARSE * rounding, min(noise, most, *(noise_of_differences(readings, order, step) for order in ORDERS))
        )
    travel = max((float(np.ptp(row)) for row in readings), default=0.0)
    return max(rounding, noise, SMALLEST, CLOSEST * travel)


def ratios(squares: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Return errors over the floor, the geometric mean over episodes, from mean squares (E, n): shape (n,).

    One episode that went astray does not rule, as it would a mean, nor is it overlooked, as a median would.
    """
    return np.asarray(np.exp(0.5 * np.log(np.maximum(squares, 1e-300)).mean(axis=0)) / floor)
