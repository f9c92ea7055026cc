"""Motor babbling: a new random target every few control steps, as in the paper's simulated recordings."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, hold


@dataclass(frozen=True, kw_only=True)
class Babbling(Excitation):
    """Uniformly random targets, which change before the robot reaches them.

    Attributes:
        every: Control steps between two targets.
    """

    every: int = 10

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the targets; see `Excitation.shape`."""
        return hold(rng.uniform(-1, 1, (episodes, -(-steps // self.every), len(span))), steps, self.every)
