"""The USB adapter is unplugged."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, LineGone


@dataclass(frozen=True, kw_only=True)
class AdapterPulled(Fault):
    """The port vanishes."""

    def apply(self, arm: VirtualArm) -> None:
        """Close the port; see `Fault.apply`."""
        raise LineGone
