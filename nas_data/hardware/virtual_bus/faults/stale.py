"""The servos' readings are renewed less often than they are asked for, as where a slower loop reads the bus."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Stale(Fault):
    """Old readings.

    Attributes:
        every: Steps of the arm's motion, of 10 ms each, between two renewals.
    """

    every: int = 2

    def strike(self, arm: VirtualArm) -> None:
        """Slow the renewal down; see `Fault.strike`."""
        arm.body.renewal = self.every * 0.01
