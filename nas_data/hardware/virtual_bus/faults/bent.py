"""A joint was moved by hand before the recording, possibly beyond its limits."""

from dataclasses import dataclass

import numpy as np

from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault


@dataclass(frozen=True, kw_only=True)
class Bent(Fault):
    """A joint is in another position."""

    servo: int = 1  # number of its servo in the arm, from 1
    radians: float = 1.9  # new position of the joint [rad]

    def apply(self, arm: VirtualArm) -> None:
        """Move the joint; see `Fault.apply`.

        Raises:
            OptionError: the arm has no such servo.
        """
        if not 1 <= self.servo <= len(arm.servos):
            raise OptionError(f"A fault bends servo {self.servo}; the virtual arm has 1 to {len(arm.servos)}.")
        positions = arm.body.positions.copy()
        positions[self.servo - 1] = self.radians
        arm.body.set_state(np.concatenate([positions, np.zeros_like(positions)]))
