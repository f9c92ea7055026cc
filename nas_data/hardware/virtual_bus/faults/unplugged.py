"""A servo is unplugged: it neither answers nor moves."""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.faults.base import Fault, find_servo


@dataclass(frozen=True, kw_only=True)
class Unplugged(Fault):
    """One servo is disconnected."""

    servo: int = 3  # its ID

    def apply(self, arm: VirtualArm) -> None:
        """Remove the servo from the line; see `Fault.apply`."""
        servo = find_servo(arm, self.servo)
        servo.put("torque_enable", 0)
        arm.chain.servos.remove(servo)
