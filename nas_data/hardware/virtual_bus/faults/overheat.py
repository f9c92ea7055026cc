"""A servo gets too hot and shuts down."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, struck


@dataclass(frozen=True, kw_only=True)
class Overheat(Fault):
    """One servo is hot at once.

    Attributes:
        servo: Its identity.
        celsius: How hot [°C]; it shuts down above its limit, 65 °C at the factory.
    """

    servo: int = 2
    celsius: float = 80.0

    def strike(self, arm: VirtualArm) -> None:
        """Heat the servo; see `Fault.strike`."""
        index = arm.servos.index(struck(arm, self.servo))
        arm.body.electrics.temperature[index] = self.celsius
        arm.body.sense()
