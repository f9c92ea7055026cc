"""A servo loses its plug, and is neither heard nor driven from then on."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, struck


@dataclass(frozen=True, kw_only=True)
class Unplugged(Fault):
    """One servo is gone.

    Attributes:
        servo: Its identity.
    """

    servo: int = 3

    def strike(self, arm: VirtualArm) -> None:
        """Take the servo off the line; see `Fault.strike`."""
        servo = struck(arm, self.servo)
        servo.put("torque_enable", 0)
        arm.chain.servos.remove(servo)
