"""The servos do not know sync read, as with some firmware and adapters."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class NoSyncRead(Fault):
    """Silence where sync read is asked for."""

    def strike(self, arm: VirtualArm) -> None:
        """Forget the instruction; see `Fault.strike`."""
        for servo in arm.servos:
            servo.answers_sync = False
