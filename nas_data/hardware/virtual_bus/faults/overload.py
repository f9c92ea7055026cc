"""A servo was stalled for too long and shuts down: its torque limit falls to zero, it blinks red."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, struck
from nas_data.hardware.virtual_bus.kinds.base import Reason


@dataclass(frozen=True, kw_only=True)
class Overload(Fault):
    """One servo gives up.

    Attributes:
        servo: Its identity.
    """

    servo: int = 2

    def strike(self, arm: VirtualArm) -> None:
        """Shut the servo down; see `Fault.strike`."""
        struck(arm, self.servo).fail(Reason.OVERLOAD)
