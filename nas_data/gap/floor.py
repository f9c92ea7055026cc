"""Noise floor: smallest error that a model can reach on quantised, noisy readings."""

from typing import TYPE_CHECKING

import numpy as np

from nas_data.arrays import thin_evenly
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.noise import DEVIATION_PER_MAD, ODD, ORDERS, SMALLEST, estimate_noise, estimate_resolution
from nas_data.pairing import read_scene_states
from nas_data.simulators.base import Simulator

if TYPE_CHECKING:
    from nas_data.gap.episode_batch import EpisodeBatch

MIN_ERROR_SHARE = 3e-4  # smallest error of a simulator, as a share of the joint's travel
COARSE_ROUNDINGS = 2.0  # [rounding errors] above which apparent noise may be fast motion
STEPS = 4000  # most transitions of which one-step errors are computed


def estimate_noise_floor(evidence: "EpisodeBatch", most: np.ndarray | None = None) -> np.ndarray:
    """Estimate the standard deviation of the position readings' error [rad; m], shape (n,).

    A quantum Δ gives Δ/√12. Further noise appears in differences of high order, in which smooth motion nearly vanishes.
    Apparent noise far above the rounding error may be fast motion. It then also has to appear in higher differences,
    and may not exceed the one-step errors of a model.

    Args:
        evidence: Readings.
        most: Standard deviation of one-step errors [rad; m], shape (n,); see `measure_step_errors`.
    """
    limits = np.full(len(evidence.joints), np.inf) if most is None else most
    return np.array([estimate_joint_floor(evidence, joint, float(limit)) for joint, limit in enumerate(limits)])


def measure_step_errors(dataset: Dataset, simulator: Simulator) -> np.ndarray:
    """Return the standard deviation of a model's one-step errors from their median [rad; m], shape (n,).

    It is an upper bound of the noise, because errors of the model only add to it.
    """
    rows = thin_evenly(dataset.n_frames, STEPS)
    predicted = simulator.predict(
        read_scene_states(dataset, simulator, rows).astype(float), dataset.commands[rows].astype(float)
    )
    n = len(dataset.joints)
    errors = np.abs(predicted[:, :n] - dataset.next_states[rows, :n])
    return DEVIATION_PER_MAD * np.median(np.where(np.isfinite(errors), errors, np.inf), axis=0)


def estimate_joint_floor(evidence: "EpisodeBatch", joint: int, most: float) -> float:
    """Return the floor of one joint [rad; m], with an upper bound of the noise."""
    readings = [row[seen, joint] for row, seen in zip(evidence.measured, evidence.mask, strict=True)]
    step = estimate_resolution(readings)
    rounding = step / np.sqrt(12.0)
    noise = min(estimate_noise(readings, order, step) for order in ODD)
    if noise > COARSE_ROUNDINGS * rounding:
        noise = max(
            COARSE_ROUNDINGS * rounding, min(noise, most, *(estimate_noise(readings, order, step) for order in ORDERS))
        )
    travel = max((float(np.ptp(row)) for row in readings), default=0.0)
    return max(rounding, noise, SMALLEST, MIN_ERROR_SHARE * travel)


def compute_floor_ratios(squares: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Return errors over the floor, as a mean over episodes, shape (n,).

    It is √(exp(mean log(1 + r²)) − 1) of the ratios r of the episodes, the mean of the likelihood of errors. Far above
    the floor, this is the geometric mean, so that one diverging episode does not dominate. Episodes far below the
    floor, in which a joint rests, do not hide others.

    Args:
        squares: Mean squared errors [rad²; m²], shape (E, n).
        floor: Noise floors [rad; m], shape (n,) or (E, n).
    """
    return np.asarray(np.sqrt(np.expm1(np.log1p(squares / floor**2).mean(axis=0))))
