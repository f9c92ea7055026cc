"""Under what a case is recorded: control rate, episodes, command signal, and what the sensors make of the truth."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensor:
    """What a servo reports of its joint."""

    noise: float  # standard deviation of a position before rounding [rad]
    quantum: float  # resolution of a position [rad]; 0 for an exact one
    floor: float  # what of it counts as the noise floor [rad]
    # standard deviation of a measured speed [rad/s]; None where speeds are differences of positions
    speed_noise: float | None = None

    def positions(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return reported positions [rad]: noise, then rounding."""
        noisy = true + self.noise * rng.standard_normal(true.shape)
        return np.round(noisy / self.quantum) * self.quantum if self.quantum else noisy

    def speeds(self, true: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return reported speeds [rad/s]; None where none is measured."""
        return None if self.speed_noise is None else true + self.speed_noise * rng.standard_normal(true.shape)


@dataclass(frozen=True)
class Conditions:
    """What holds for every episode of a case."""

    rate: float  # control rate [Hz]
    seconds: float  # length of an episode [s]
    episodes: int  # how many are handed over
    fresh: int  # how many are kept back
    settle: float  # for how long the first pose is commanded before an episode begins [s]
    signal: str  # name of the command signal
    sensor: Sensor  # what the servos report
    # into how many episodes each motion under commanded torques is cut, all of which begin in motion; 0 where positions
    # are commanded and episodes begin at rest
    pieces: int = 0

    @property
    def period(self) -> float:
        """Control period [s]."""
        return 1 / self.rate

    @property
    def steps(self) -> int:
        """Control periods in an episode."""
        return round(self.seconds * self.rate)
