"""A servo overheats and shuts down."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, find_servo


@dataclass(frozen=True, kw_only=True)
class Overheat(Fault):
    """One servo has a high temperature."""

    servo: int = 2  # its ID
    celsius: float = 80.0  # temperature [°C]; the servo shuts down above its limit, 65 °C at the factory

    def apply(self, arm: VirtualArm) -> None:
        """Heat the servo; see `Fault.apply`."""
        index = arm.servos.index(find_servo(arm, self.servo))
        arm.body.electrics.temperature[index] = self.celsius
        arm.body.sense()
