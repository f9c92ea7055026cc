"""The USB adapter is pulled out: the port is gone."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, LineGone


@dataclass(frozen=True, kw_only=True)
class AdapterPulled(Fault):
    """Nothing is left to talk to."""

    def strike(self, arm: VirtualArm) -> None:
        """Close the port; see `Fault.strike`."""
        raise LineGone
