"""Usual error: what a model leaves unexplained, beyond noise, in a recording of a robot that it describes."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize

SMALLEST_SHARE = 1e-6  # smallest share of a joint's motion that its error is expected to be
SCALES = 1e-3, 1e3  # bounds of the factor that makes errors as large as expected on average


@dataclass(frozen=True)
class UsualError:
    """Expected error √(rest² + (share · motion)²) of each joint; motion is the standard deviation of its positions.

    Attributes:
        rest: Error without motion, noise included [rad; m], shape (n,).
        share: Growth of the error with the motion, shape (n,).
        floor: Noise floor [rad; m], shape (n,).
    """

    rest: np.ndarray
    share: np.ndarray
    floor: np.ndarray

    @classmethod
    def fit(cls, errors: np.ndarray, motions: np.ndarray, floor: np.ndarray) -> "UsualError":
        """Fit both numbers to episodes, so that the mean ratio of errors is one; see `compute_floor_ratios`.

        Args:
            errors: RMS errors of the model [rad; m], shape (E, n).
            motions: Standard deviations of the positions [rad; m], shape (E, n).
            floor: Noise floor, the least error [rad; m], shape (n,).
        """
        fitted = [fit_joint(*columns) for columns in zip(errors.T, motions.T, floor, strict=True)]
        rest, share = np.array(fitted).T
        return cls(np.maximum(rest, floor), share, floor)

    def predict(self, motions: np.ndarray) -> np.ndarray:
        """Return the expected errors beyond noise of episodes with given motions, shape (E, n) each [rad; m]."""
        return np.asarray(np.sqrt(self.rest**2 - self.floor**2 + (self.share * motions) ** 2))


def fit_joint(errors: np.ndarray, motions: np.ndarray, floor: float) -> tuple[float, float]:
    """Return the error without motion [rad; m] and its growth with the motion, of one joint.

    Their ratio is that of the largest likelihood of normal errors.
    """
    squares = errors**2
    typical = max(float(np.sqrt(squares.mean())), floor)
    largest = 10 * typical / max(float(np.sqrt((motions**2).mean())), floor)

    def expect(logarithms: np.ndarray) -> np.ndarray:
        rest, share = np.exp(logarithms)
        return np.asarray(rest**2 + (share * motions) ** 2)

    def lack_of_fit(logarithms: np.ndarray) -> float:
        expected = expect(logarithms)
        return float((squares / expected + np.log(expected)).sum())

    bounds = np.log([[floor, 2 * typical], [SMALLEST_SHARE, max(2 * SMALLEST_SHARE, largest)]])
    found = minimize(lack_of_fit, np.log([typical, max(0.1 * largest, SMALLEST_SHARE)]), bounds=bounds).x
    ratios = squares / expect(found)

    def exceed(logarithm: float) -> float:
        return float(np.log1p(ratios * np.exp(-2 * logarithm)).mean() - np.log(2.0))

    low, high = np.log(SCALES)
    scale = brentq(exceed, low, high) if exceed(low) > 0 else low
    rest, share = np.exp(found + scale)
    return float(rest), float(share)
