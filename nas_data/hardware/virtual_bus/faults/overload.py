"""A servo was stalled for too long and shuts down; its torque limit is set to zero."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, find_servo
from nas_data.hardware.virtual_bus.kinds.base import Reason


@dataclass(frozen=True, kw_only=True)
class Overload(Fault):
    """One servo shuts down."""

    servo: int = 2  # its ID

    def apply(self, arm: VirtualArm) -> None:
        """Shut the servo down; see `Fault.apply`."""
        find_servo(arm, self.servo).fail(Reason.OVERLOAD)
