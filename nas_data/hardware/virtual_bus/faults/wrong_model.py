"""The arm contains a servo of another series."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, find_servo

XL330_M077 = 1190  # model number, ROBOTIS e-manual


@dataclass(frozen=True, kw_only=True)
class WrongModelFault(Fault):
    """One servo has another model number."""

    servo: int = 5  # its ID
    model: int = XL330_M077  # its model number

    def apply(self, arm: VirtualArm) -> None:
        """Change the model number; see `Fault.apply`."""
        find_servo(arm, self.servo).put("model_number", self.model)
