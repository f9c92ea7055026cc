"""Random targets connected by ramps, similar to the commands of a trained policy."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation


@dataclass(frozen=True, kw_only=True)
class Ramps(Excitation):
    """Uniformly random targets with linear interpolation between them.

    Attributes:
        every: Control steps between two targets.
    """

    every: int = 25

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the targets and interpolate; see `Excitation.shape`."""
        targets = rng.uniform(-1, 1, (episodes, 1 + -(-steps // self.every), len(span)))
        index, step = np.divmod(np.arange(steps), self.every)
        part = (step / self.every)[None, :, None]
        return np.asarray((1 - part) * targets[:, index] + part * targets[:, index + 1])
