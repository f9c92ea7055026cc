"""ROBOTIS XL-320; source of control table and units: e-manual."""

import math
from typing import TYPE_CHECKING

from nas_data.hardware.virtual_bus.kinds.base import STILL, VOLT, Reason, ServoDrive, ServoMeasurements, ServoSeries
from nas_data.hardware.virtual_bus.packet import Error
from nas_data.hardware.xl320 import control_table as table

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

GAIN = 32  # P register at which the stiffness equals the model's
FULL = 1023


class Xl320Kind(ServoSeries):
    """The servo of the ErgoJr; its integral and derivative gain have no effect."""

    registers = table.REGISTERS
    tick = table.TICK
    supply = 7.4
    stall_current = 1.1  # [A] at 7.4 V
    stall_torque = 0.39  # [N m] at 7.4 V
    baud = {0: 9600, 1: 57_600, 2: 115_200, 3: 1_000_000}  # noqa: RUF012  # never changed
    bits = {Reason.OVERLOAD: table.OVERLOAD, Reason.OVERHEAT: table.OVERHEAT, Reason.VOLTAGE: table.VOLTAGE}  # noqa: RUF012
    unloads = "torque_limit"

    def is_persistent(self, register: table.ControlTableEntry) -> bool:
        """Whether a register survives a loss of power."""
        return register.address < table.RAM

    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """Return the drive state that the registers define."""
        speed = servo.get("moving_speed") & FULL
        return ServoDrive(
            powered=bool(servo.get("torque_enable")),
            goal=servo.get("goal_position"),
            speed=speed * table.SPEED_UNIT if speed else math.inf,
            stiffness=servo.get("p_gain") / GAIN,
            strength=min(servo.get("torque_limit"), servo.get("max_torque")) / FULL,
        )

    def sense(self, servo: "VirtualServo", measured: ServoMeasurements) -> None:
        """Write measurements into the registers."""
        servo.put("present_position", max(0, min(table.HIGHEST, measured.position)))
        servo.put("present_speed", table.encode_sign_magnitude(measured.speed / table.SPEED_UNIT))
        servo.put("present_load", table.encode_sign_magnitude(measured.effort / table.LOAD_UNIT))
        servo.put("present_voltage", round(measured.voltage / VOLT))
        servo.put("present_temperature", measured.degrees_celsius)
        servo.put("moving", int(abs(measured.speed) > STILL))

    def check_write(self, servo: "VirtualServo", register: table.ControlTableEntry, value: int) -> Error:
        """Refuse goals beyond the angle limits."""
        within = servo.get("cw_limit") <= value <= servo.get("ccw_limit")
        refused = register.name == "goal_position" and not within and servo.get("control_mode") == 2
        return Error.DATA_LIMIT if refused else Error.NONE

    def power_on(self, servo: "VirtualServo") -> None:
        """Set the torque limit to its persistent value."""
        servo.put("torque_limit", servo.get("max_torque"))


KIND = Xl320Kind()
