"""The servos do not support sync read, as with some firmware and adapters."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class NoSyncRead(Fault):
    """Servos do not answer sync reads."""

    def apply(self, arm: VirtualArm) -> None:
        """Disable sync read; see `Fault.apply`."""
        for servo in arm.servos:
            servo.answers_sync = False
