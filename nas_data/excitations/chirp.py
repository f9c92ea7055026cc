"""A sine whose frequency rises exponentially over the episode."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, draw_signs


@dataclass(frozen=True, kw_only=True)
class Chirp(Excitation):
    """Each joint sweeps the same frequency band with random sign and amplitude.

    Attributes:
        slowest: Frequency at the start [Hz].
        fastest: Frequency at the end [Hz].
    """

    slowest: float = 0.2
    fastest: float = 3.0
    share: float = 0.3

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw amplitudes and signs; see `Excitation.shape`."""
        time = period * np.arange(steps)
        rate = np.log(self.fastest / self.slowest) / (period * max(steps, 1))
        # integral of slowest · exp(rate · t); its limit for a constant frequency is slowest · t
        turns = self.slowest * (np.expm1(rate * time) / rate if rate else time)
        amplitude = draw_signs(rng, episodes, len(span)) * rng.uniform(0.5, 1, (episodes, 1, len(span)))
        return np.asarray(amplitude * np.sin(2 * np.pi * turns)[None, :, None])
