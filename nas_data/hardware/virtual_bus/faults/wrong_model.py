"""A servo of another series sits in the arm."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, struck

XL330_M077 = 1190  # model number, ROBOTIS e-manual


@dataclass(frozen=True, kw_only=True)
class WrongModelFault(Fault):
    """One servo is not what it should be.

    Attributes:
        servo: Its identity.
        model: Its model number.
    """

    servo: int = 5
    model: int = XL330_M077

    def strike(self, arm: VirtualArm) -> None:
        """Exchange the servo; see `Fault.strike`."""
        struck(arm, self.servo).put("model_number", self.model)
