"""The supply voltage is too low for all servos."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Undervoltage(Fault):
    """A low supply voltage."""

    volts: float = 5.5  # supply voltage [V]

    def apply(self, arm: VirtualArm) -> None:
        """Lower the supply voltage; see `Fault.apply`."""
        electrics = arm.body.electrics
        electrics.supply = electrics.voltage = self.volts
        arm.body.sense()
