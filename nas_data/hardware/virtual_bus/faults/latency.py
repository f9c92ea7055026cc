"""Replies come late now and then, as from an adapter with a slow latency timer or a computer that is busy."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Latency(Fault):
    """Spikes of delay.

    Attributes:
        share: Share of the instructions whose replies come late.
        seconds: By how much [s].
    """

    share: float = 0.01
    seconds: float = 0.06

    def delay(self, rng: np.random.Generator) -> float:
        """Wait now and then; see `Fault.delay`."""
        return self.seconds if rng.random() < self.share else 0.0
