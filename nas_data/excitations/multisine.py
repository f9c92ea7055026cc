"""A sum of sines with random phases per joint, which covers a frequency band."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, check_band


@dataclass(frozen=True, kw_only=True)
class Multisine(Excitation):
    """Logarithmically spaced sines with amplitudes ∝ 1 / frequency, so that all have the same peak speed.

    Attributes:
        slowest: Lowest frequency [Hz].
        fastest: Highest frequency [Hz].
        count: Number of sines.
    """

    slowest: float = 0.1
    fastest: float = 2.0
    count: int = 8
    share: float = 0.8

    def __post_init__(self) -> None:
        super().__post_init__()
        check_band(self, self.slowest, self.fastest)

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the phases; the sum is scaled so that each joint uses its whole share in each episode."""
        frequencies = np.geomspace(self.slowest, self.fastest, self.count)
        phases = rng.uniform(0, 2 * np.pi, (episodes, len(span), self.count))
        time = period * np.arange(steps)
        total = np.zeros((episodes, steps, len(span)))
        for index, frequency in enumerate(frequencies):
            turns = 2 * np.pi * frequency * time[None, :, None] + phases[:, None, :, index]
            total += np.sin(turns) / frequency
        return total / np.abs(total).max(axis=1, keepdims=True)
