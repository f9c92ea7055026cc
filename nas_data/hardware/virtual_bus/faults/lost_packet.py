"""Lost instructions and replies."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class LostPacket(Fault):
    """Packets are lost, as with a loose plug."""

    share: float = 0.01  # share of the packets that are lost

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Drop a random share; see `Fault.instruction`."""
        return b"" if rng.random() < self.share else content

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Drop a random share; see `Fault.reply`."""
        return b"" if rng.random() < self.share else content
