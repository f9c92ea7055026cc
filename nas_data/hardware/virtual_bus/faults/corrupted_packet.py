"""Bit errors on the line, in both directions."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class CorruptedPacket(Fault):
    """Noise on the line."""

    share: float = 0.01  # share of the packets with one wrong bit

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Flip a bit; see `Fault.instruction`."""
        return self.reply(content, rng)

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Flip a bit; see `Fault.reply`."""
        if not content or rng.random() >= self.share:
            return content
        damaged = bytearray(content)
        damaged[int(rng.integers(len(damaged)))] ^= 1 << int(rng.integers(8))
        return bytes(damaged)
