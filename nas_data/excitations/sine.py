"""One sine per joint with random frequency and amplitude, around the middle of its range."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, check_band, draw_signs


@dataclass(frozen=True, kw_only=True)
class Sine(Excitation):
    """Each joint has its own frequency (logarithmically uniform), so that joints do not move in phase.

    Attributes:
        slowest: Lowest frequency [Hz].
        fastest: Highest frequency [Hz].
        smallest: Smallest amplitude over the largest.
    """

    slowest: float = 0.2
    fastest: float = 1.0
    smallest: float = 0.3
    share: float = 0.8

    def __post_init__(self) -> None:
        super().__post_init__()
        check_band(self, self.slowest, self.fastest)

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the sines; see `Excitation.shape`."""
        each = (episodes, 1, len(span))
        frequency = np.exp(rng.uniform(np.log(self.slowest), np.log(self.fastest), each))
        amplitude = draw_signs(rng, episodes, len(span)) * rng.uniform(min(self.smallest, 1), 1, each)
        time = period * np.arange(steps)[None, :, None]
        return np.asarray(amplitude * np.sin(2 * np.pi * frequency * time))
