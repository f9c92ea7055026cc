"""The supply gives too little, for all servos."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Undervoltage(Fault):
    """An empty battery.

    Attributes:
        volts: What is left of the supply [V].
    """

    volts: float = 5.5

    def strike(self, arm: VirtualArm) -> None:
        """Lower the supply; see `Fault.strike`."""
        electrics = arm.body.electrics
        electrics.supply = electrics.voltage = self.volts
        arm.body.sense()
