"""Random targets joined by ramps: commands as smooth as those of a trained policy."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation


@dataclass(frozen=True, kw_only=True)
class Ramps(Excitation):
    """Uniformly random targets, the first one at once, each later one approached along a straight line.

    Attributes:
        every: Control steps from one target to the next.
    """

    every: int = 25

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the targets and what lies between; see `Excitation.shape`."""
        targets = rng.uniform(-1, 1, (episodes, 1 + -(-steps // self.every), len(span)))
        done, under_way = np.divmod(np.arange(steps), self.every)
        part = (under_way / self.every)[None, :, None]
        return np.asarray((1 - part) * targets[:, done] + part * targets[:, done + 1])
