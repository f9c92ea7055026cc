"""ROBOTIS XL-320; source of control table and units: e-manual."""

import math
from typing import TYPE_CHECKING

from nas_data.hardware.virtual_bus.kinds.base import STILL, VOLT, Reason, ServoDrive, ServoMeasurements, ServoSeries
from nas_data.hardware.virtual_bus.packet import Error
from nas_data.hardware.xl320.control_table import (
    HIGHEST,
    LOAD_UNIT,
    OVERHEAT,
    OVERLOAD,
    RAM,
    REGISTERS,
    SPEED_UNIT,
    TICK,
    VOLTAGE,
    ControlTableEntry,
    encode_sign_magnitude,
)

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

GAIN = 32  # P register at which the stiffness equals the model's
FULL = 1023


class Xl320Kind(ServoSeries):
    """The servo of the ErgoJr; its integral and derivative gain have no effect."""

    registers = REGISTERS
    tick = TICK
    supply = 7.4
    stall_current = 1.1  # [A] at 7.4 V
    stall_torque = 0.39  # [N m] at 7.4 V
    baud = {0: 9600, 1: 57_600, 2: 115_200, 3: 1_000_000}  # noqa: RUF012  # never changed
    bits = {Reason.OVERLOAD: OVERLOAD, Reason.OVERHEAT: OVERHEAT, Reason.VOLTAGE: VOLTAGE}  # noqa: RUF012
    unloads = "torque_limit"

    def is_persistent(self, register: ControlTableEntry) -> bool:
        """See `ServoSeries.is_persistent`."""
        return register.address < RAM

    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """See `ServoSeries.drive`."""
        speed = servo.get("moving_speed") & FULL
        return ServoDrive(
            powered=bool(servo.get("torque_enable")),
            goal=servo.get("goal_position"),
            speed=speed * SPEED_UNIT if speed else math.inf,
            stiffness=servo.get("p_gain") / GAIN,
            strength=min(servo.get("torque_limit"), servo.get("max_torque")) / FULL,
        )

    def sense(self, servo: "VirtualServo", measured: ServoMeasurements) -> None:
        """See `ServoSeries.sense`."""
        servo.put("present_position", max(0, min(HIGHEST, measured.position)))
        servo.put("present_speed", encode_sign_magnitude(measured.speed / SPEED_UNIT))
        servo.put("present_load", encode_sign_magnitude(measured.effort / LOAD_UNIT))
        servo.put("present_voltage", round(measured.voltage / VOLT))
        servo.put("present_temperature", measured.degrees_celsius)
        servo.put("moving", int(abs(measured.speed) > STILL))

    def check_write(self, servo: "VirtualServo", register: ControlTableEntry, value: int) -> Error:
        """Refuse goals beyond the angle limits."""
        within = servo.get("cw_limit") <= value <= servo.get("ccw_limit")
        refused = register.name == "goal_position" and not within and servo.get("control_mode") == 2
        return Error.DATA_LIMIT if refused else Error.NONE

    def power_on(self, servo: "VirtualServo") -> None:
        """Set the torque limit to its persistent value."""
        servo.put("torque_limit", servo.get("max_torque"))


KIND = Xl320Kind()
