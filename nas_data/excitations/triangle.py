"""Slow motion at constant speed with sharp reversals: shows friction, backlash and droop."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, directions


@dataclass(frozen=True, kw_only=True)
class Triangle(Excitation):
    """Each joint goes up and down at a constant speed, starting from the middle of its range.

    Attributes:
        speed: Highest commanded speed [rad/s; of a slide its ranges over π]; each joint draws its own from half of it
            upwards.
    """

    speed: float = 0.5
    share: float = 0.8

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw speeds and directions; see `Excitation.shape`."""
        speed = self.speed * rng.uniform(0.5, 1, (episodes, 1, len(span)))
        way = speed * period * np.arange(steps)[None, :, None] / np.where(span > 0, span, 1)
        # a triangle of amplitude 1 and period 4 that rises through 0
        folded = 1 - np.abs((way + 1) % 4 - 2)
        return directions(rng, episodes, len(span)) * folded
