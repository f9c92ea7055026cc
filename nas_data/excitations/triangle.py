"""Slow motion at constant speed with sharp reversals, which shows friction, backlash and droop."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, draw_signs


@dataclass(frozen=True, kw_only=True)
class Triangle(Excitation):
    """Each joint moves up and down at a constant speed, starting in the middle of its range.

    Attributes:
        speed: Highest commanded speed [rad/s; for slides in range / π per second]; each joint has a random speed
            between half of it and all of it.
    """

    speed: float = 0.5
    share: float = 0.8

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw speeds and signs; see `Excitation.shape`."""
        speed = self.speed * rng.uniform(0.5, 1, (episodes, 1, len(span)))
        distance = speed * period * np.arange(steps)[None, :, None] / np.where(span > 0, span, 1)
        # a triangle wave of amplitude 1 and period 4 that rises through 0
        folded = 1 - np.abs((distance + 1) % 4 - 2)
        return draw_signs(rng, episodes, len(span)) * folded
