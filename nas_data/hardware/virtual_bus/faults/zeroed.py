"""The arm is put into its zero pose by hand, as for a calibration."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Zeroed(Fault):
    """All joints are at zero."""

    def apply(self, arm: VirtualArm) -> None:
        """Set the pose; see `Fault.apply`."""
        arm.body.set_state(np.zeros(2 * len(arm.servos)))
