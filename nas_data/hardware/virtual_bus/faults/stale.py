"""Readings are updated less often than they are read, as if a slower loop read the bus."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Stale(Fault):
    """Outdated readings."""

    every: int = 2  # update period of the readings in steps of 10 ms

    def apply(self, arm: VirtualArm) -> None:
        """Set the update period; see `Fault.apply`."""
        arm.body.renewal = self.every * 0.01
