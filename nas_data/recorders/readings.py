"""Sensor model: noise and quantisation of a robot's reported state."""

import math
from dataclasses import dataclass

import numpy as np

from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Sensor model: Gaussian noise, then rounding to the sensor's resolution.

    Attributes:
        noise: Standard deviation of the position noise [rad; slides m].
        quantum: Resolution of the position [rad; m]; 0 for exact.
        velocity_noise: Standard deviation of the noise in the velocity register [rad/s; m/s].
        velocity_quantum: Resolution of the velocity register [rad/s; m/s]; 0 for exact.
    """

    noise: float = 0.0
    quantum: float = 0.0
    velocity_noise: float = 0.0
    velocity_quantum: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf:
                raise OptionError(f"{name.replace('_', ' ')} is {value}; it must be zero or more.")

    def of(self, states: np.ndarray, rng: np.random.Generator, joints: int | None = None) -> np.ndarray:
        """Return the reported states, of the same shape.

        Args:
            states: Positions [rad; m] then velocities [rad/s; m/s], shape (…, 2n). States of objects may follow, and
                are reported unchanged.
            rng: Source of the noise.
            joints: Number of joints n; required if states of objects follow.
        """
        n = states.shape[-1] // 2 if joints is None else joints
        return np.concatenate(
            [
                simulate_reading(states[..., :n], self.noise, self.quantum, rng),
                simulate_reading(states[..., n : 2 * n], self.velocity_noise, self.velocity_quantum, rng),
                states[..., 2 * n :],
            ],
            axis=-1,
        )


def simulate_reading(values: np.ndarray, noise: float, quantum: float, rng: np.random.Generator) -> np.ndarray:
    """Return values with Gaussian noise, rounded to multiples of a quantum."""
    noisy = values + noise * rng.standard_normal(values.shape) if noise else values
    return np.round(noisy / quantum) * quantum if quantum else noisy
