"""Two servos have the same ID and answer at the same time."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, find_servo


@dataclass(frozen=True, kw_only=True)
class DuplicateIdFault(Fault):
    """One servo gets the ID of another."""

    servo: int = 4  # ID of the servo before
    identity: int = 3  # its new ID
    return_delay: int = 250  # its return delay in units of 2 µs; the default is the factory setting

    def apply(self, arm: VirtualArm) -> None:
        """Change the ID; see `Fault.apply`."""
        servo = find_servo(arm, self.servo)
        servo.put("id", self.identity)
        servo.put("return_delay", self.return_delay)
