"""ROBOTIS XL-320; source of table and units: e-manual."""

import math
from typing import TYPE_CHECKING

from nas_data.virtual_bus.kinds.base import STILL, Bounds, Drive, Kind, Reason, Sensation
from nas_data.virtual_bus.packet import Error
from nas_data.xl320.control_table import OVERHEAT, OVERLOAD, RAM, REGISTERS, VOLTAGE, Register
from nas_data.xl320.units import HIGHEST, LOAD_UNIT, SPEED_UNIT, TICK, VOLT, sign_magnitude

if TYPE_CHECKING:
    from nas_data.virtual_bus.servo import Servo

GAIN = 32  # value of the P register at which the servo is as stiff as the model
FULL = 1023
OVERLOAD_SHARE = 0.95  # share of the largest torque that counts as stalled
OVERLOAD_SECONDS = 2.0  # [s] of it after which the servo gives up
BITS = {Reason.OVERLOAD: OVERLOAD, Reason.OVERHEAT: OVERHEAT, Reason.VOLTAGE: VOLTAGE}  # of hardware error, shutdown


class Xl320Kind(Kind):
    """Six of them make an ErgoJr; the integral and derivative gain, which the model lacks, do nothing."""

    registers = REGISTERS
    tick = TICK
    supply = 7.4
    stall_current = 1.1  # [A] at 7.4 V
    stall_torque = 0.39  # [N m] at 7.4 V
    baud = {0: 9600, 1: 57_600, 2: 115_200, 3: 1_000_000}  # noqa: RUF012  # never changed

    def lasts(self, register: Register) -> bool:
        """See `Kind.lasts`."""
        return register.address < RAM

    def drive(self, servo: "Servo") -> Drive:
        """See `Kind.drive`."""
        speed = servo.get("moving_speed") & FULL
        return Drive(
            powered=bool(servo.get("torque_enable")),
            goal=servo.get("goal_position"),
            speed=speed * SPEED_UNIT if speed else math.inf,
            stiffness=servo.get("p_gain") / GAIN,
            strength=min(servo.get("torque_limit"), servo.get("max_torque")) / FULL,
        )

    def sense(self, servo: "Servo", felt: Sensation) -> None:
        """See `Kind.sense`."""
        servo.put("present_position", max(0, min(HIGHEST, felt.position)))
        servo.put("present_speed", sign_magnitude(felt.speed / SPEED_UNIT))
        servo.put("present_load", sign_magnitude(felt.effort / LOAD_UNIT))
        servo.put("present_voltage", round(felt.voltage / VOLT))
        servo.put("present_temperature", felt.degrees_celsius)
        servo.put("moving", int(abs(felt.speed) > STILL))

    def bounds(self, servo: "Servo") -> Bounds:
        """See `Kind.bounds`."""
        return Bounds(
            lowest=servo.get("lowest_voltage") * VOLT,
            highest=servo.get("highest_voltage") * VOLT,
            hottest=float(servo.get("temperature_limit")),
            strain=OVERLOAD_SHARE,
            seconds=OVERLOAD_SECONDS,
        )

    def fail(self, servo: "Servo", reason: Reason) -> None:
        """Note it; the torque limit of a servo that shuts down falls to zero."""
        bits = sum(BITS[one] for one in reason)
        servo.put("hardware_error", servo.get("hardware_error") | bits)
        if servo.get("shutdown") & bits:
            servo.put("torque_limit", 0)

    def judge(self, servo: "Servo", register: Register, value: int) -> Error:
        """Refuse goals beyond the angle limits."""
        within = servo.get("cw_limit") <= value <= servo.get("ccw_limit")
        refused = register.name == "goal_position" and not within and servo.get("control_mode") == 2
        return Error.DATA_LIMIT if refused else Error.NONE

    def started(self, servo: "Servo") -> None:
        """Take the torque limit over from what lasts."""
        servo.put("torque_limit", servo.get("max_torque"))


KIND = Xl320Kind()
