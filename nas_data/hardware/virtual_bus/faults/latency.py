"""Some replies are delayed, as by an adapter with a slow latency timer or a busy computer."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Latency(Fault):
    """Delays of some replies."""

    share: float = 0.01  # share of the instructions with delayed replies
    seconds: float = 0.06  # delay [s]

    def delay(self, rng: np.random.Generator) -> float:
        """Return the delay for a random share of instructions; see `Fault.delay`."""
        return self.seconds if rng.random() < self.share else 0.0
