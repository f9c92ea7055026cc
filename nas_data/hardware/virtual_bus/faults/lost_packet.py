"""Packets vanish: an instruction that no servo hears, a reply that never arrives."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class LostPacket(Fault):
    """A loose plug.

    Attributes:
        share: Share of the packets that are lost.
    """

    share: float = 0.01

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Lose some; see `Fault.instruction`."""
        return b"" if rng.random() < self.share else content

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Lose some; see `Fault.reply`."""
        return b"" if rng.random() < self.share else content
