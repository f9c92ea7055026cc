"""Somebody puts the arm into its zero pose by hand, as a calibration asks for."""

from dataclasses import dataclass

import numpy as np

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Zeroed(Fault):
    """All joints stand at zero."""

    def strike(self, arm: VirtualArm) -> None:
        """Put the arm there; see `Fault.strike`."""
        arm.body.set_state(np.zeros(2 * len(arm.servos)))
