"""Random targets, each held for a second: the paper's protocol on the real robot."""

from dataclasses import dataclass

import numpy as np

from nas_data.excitations.base import Excitation, hold


@dataclass(frozen=True, kw_only=True)
class Steps(Excitation):
    """Uniformly random targets, which change for all joints at the same time.

    Attributes:
        seconds: Time for which each target is held [s].
    """

    seconds: float = 1.0

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw the targets; see `Excitation.shape`."""
        each = max(1, round(self.seconds / period))
        return hold(rng.uniform(-1, 1, (episodes, -(-steps // each), len(span))), steps, each)
