"""Two servos have one identity, because one was never renamed, and speak at the same time."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, struck


@dataclass(frozen=True, kw_only=True)
class DuplicateIdFault(Fault):
    """One servo takes the identity of another.

    Attributes:
        servo: The one that was renamed.
        identity: What it is called now.
        return_delay: Its return delay in units of 2 µs; the factory's where the other's was not changed either.
    """

    servo: int = 4
    identity: int = 3
    return_delay: int = 250

    def strike(self, arm: VirtualArm) -> None:
        """Rename the servo; see `Fault.strike`."""
        servo = struck(arm, self.servo)
        servo.put("id", self.identity)
        servo.put("return_delay", self.return_delay)
