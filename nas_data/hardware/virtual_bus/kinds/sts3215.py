"""Feetech STS3215 (7.4 V), the servo of the SO-100 and SO-101.

Sources: Feetech, memory table of the STS series, as in LeRobot's `motors/feetech/tables.py`, and the data sheet of the
STS3215-C001. The integral gain and the minimum start force are not documented in detail and have no effect.
Accelerations of 0 and of 254, the highest, are simulated as unlimited.
"""

import math
from typing import TYPE_CHECKING

from nas_data.hardware.virtual_bus.feetech_packet import FEETECH
from nas_data.hardware.virtual_bus.kinds.base import (
    STILL,
    VOLT,
    Reason,
    ServoDrive,
    ServoMeasurements,
    ServoSeries,
    make_read_only,
    make_register,
)
from nas_data.hardware.virtual_bus.packet import Error, Instruction
from nas_data.hardware.xl320.control_table import ControlTableEntry

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

TURN = 4096  # units of position in a turn
TICK = 2 * math.pi / TURN  # [rad]
GAIN = 16  # P register at which the stiffness equals the model's; LeRobot's setting
ACCELERATION_UNIT = 100 * TICK  # [rad/s²]
FASTEST = 254  # acceleration register that is simulated as unlimited
CURRENT_UNIT, PROTECTION_UNIT = 0.0065, 0.01  # [A], [s]
THOUSAND, HUNDRED = 1000, 100  # register values of full torque or load, and of full protection torque
RAM, FACTORY = 40, 80  # registers from RAM up to FACTORY are volatile
POSITION_SIGN, OFFSET_SIGN, LOAD_SIGN = 15, 11, 10  # sign bits

REGISTERS = {
    register.name: register
    for register in (
        make_read_only("firmware_major", 0, initial=3),
        make_read_only("firmware_minor", 1, initial=10),
        make_read_only("model_number", 3, 2, 777),
        make_register("id", 5, initial=1, high=253),
        make_register("baud_rate", 6, high=7),
        make_register("return_delay", 7, initial=250, high=254),
        make_register("status_level", 8, initial=1, high=1),
        make_register("lowest_position", 9, 2, high=TURN - 1),
        make_register("highest_position", 11, 2, TURN - 1, TURN - 1),
        make_register("temperature_limit", 13, initial=70, high=100),
        make_register("highest_voltage", 14, initial=80, high=254),
        make_register("lowest_voltage", 15, initial=40, high=254),
        make_register("max_torque", 16, 2, THOUSAND, THOUSAND),
        make_register("phase", 18, initial=12),
        make_register("unloading", 19, initial=44, high=254),
        make_register("alarm", 20, initial=47, high=254),
        make_register("p_gain", 21, initial=32, high=254),
        make_register("d_gain", 22, initial=32, high=254),
        make_register("i_gain", 23, high=254),
        make_register("start_force", 24, 2, 16, THOUSAND),
        make_register("cw_dead_zone", 26, initial=1, high=32),
        make_register("ccw_dead_zone", 27, initial=1, high=32),
        make_register("protection_current", 28, 2, 500, 511),
        make_register("resolution", 30, initial=1, high=3),
        make_register("homing_offset", 31, 2, high=2 * TURN - 1),
        make_register("operating_mode", 33, high=3),
        make_register("protective_torque", 34, initial=20, high=HUNDRED),
        make_register("protection_time", 35, initial=200, high=254),
        make_register("overload_torque", 36, initial=80, high=HUNDRED),
        make_register("velocity_p_gain", 37, initial=10, high=100),
        make_register("overcurrent_time", 38, initial=200, high=254),
        make_register("velocity_i_gain", 39, initial=10, high=254),
        make_register("torque_enable", 40, high=128),
        make_register("acceleration", 41, high=254),
        make_register("goal_position", 42, 2),
        make_register("goal_time", 44, 2),
        make_register("goal_speed", 46, 2),
        make_register("torque_limit", 48, 2, THOUSAND, THOUSAND),
        make_register("lock", 55, initial=1, high=1),
        make_read_only("present_position", 56, 2),
        make_read_only("present_speed", 58, 2),
        make_read_only("present_load", 60, 2),
        make_read_only("present_voltage", 62, initial=74),
        make_read_only("present_temperature", 63, initial=25),
        make_read_only("registered", 64),
        make_read_only("hardware_error", 65),
        make_read_only("moving", 66),
        make_read_only("present_current", 69, 2),
        make_read_only("goal_position_2", 71, 2),
        make_register("moving_threshold", 80, initial=1),
        make_register("time_step", 81, initial=32),
        make_register("velocity_unit", 82, initial=1),
        make_register("half_time_step", 83),
        make_register("maximum_velocity", 84, initial=40),
        make_register("maximum_acceleration", 85, initial=50, high=254),
        make_register("acceleration_multiplier", 86, initial=1),
    )
}


def decode_sign_magnitude(value: int, bit: int) -> int:
    """Return the value of a sign-magnitude register with its sign bit."""
    magnitude = value & ((1 << bit) - 1)
    return -magnitude if value >> bit & 1 else magnitude


def encode_sign_magnitude(value: float, bit: int, highest: int | None = None) -> int:
    """Return a number, rounded and limited, as the value of a sign-magnitude register."""
    most = (1 << bit) - 1 if highest is None else highest
    return min(most, round(abs(value))) | ((1 << bit) if value < 0 else 0)


class Sts3215(ServoSeries):
    """Positions are encoder counts minus the homing offset; speeds are in counts per second."""

    registers = REGISTERS
    tick = TICK
    supply = 7.4
    stall_current = 2.4  # [A]
    stall_torque = 1.91  # [N m], 19.5 kg cm
    baud = dict(enumerate((1_000_000, 500_000, 250_000, 128_000, 115_200, 57_600, 38_400, 19_200)))  # noqa: RUF012
    bits = {Reason.OVERLOAD: 32, Reason.OVERHEAT: 4, Reason.VOLTAGE: 1}  # noqa: RUF012
    protocol = FEETECH

    def is_persistent(self, register: ControlTableEntry) -> bool:
        """Whether a register survives a loss of power."""
        return register.address < RAM or register.address >= FACTORY

    def is_locked(self, servo: "VirtualServo", register: ControlTableEntry) -> bool:
        """Return False: the lock prevents persistent storage, not writing."""
        return False

    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """Return the drive state; goals are clipped to the limits."""
        goal = decode_sign_magnitude(servo.get("goal_position"), POSITION_SIGN)
        low, high = servo.get("lowest_position"), servo.get("highest_position")
        speed, acceleration = decode_sign_magnitude(servo.get("goal_speed"), POSITION_SIGN), servo.get("acceleration")
        acceleration = min(acceleration, servo.get("maximum_acceleration") or acceleration)
        unloaded = servo.get("hardware_error") & servo.get("unloading")
        strength = servo.get("torque_limit") / THOUSAND
        if unloaded & self.bits[Reason.OVERLOAD]:
            strength = min(strength, servo.get("protective_torque") / HUNDRED)
        return ServoDrive(
            powered=servo.get("torque_enable") == 1 and not unloaded & ~self.bits[Reason.OVERLOAD],
            goal=min(max(goal, low), high) + decode_sign_magnitude(servo.get("homing_offset"), OFFSET_SIGN),
            speed=abs(speed) * TICK if speed else math.inf,
            acceleration=acceleration * ACCELERATION_UNIT if 0 < acceleration < FASTEST else math.inf,
            stiffness=servo.get("p_gain") / GAIN,
            strength=strength,
            deadband=max(servo.get("cw_dead_zone"), servo.get("ccw_dead_zone")) * TICK,
        )

    def sense(self, servo: "VirtualServo", measured: ServoMeasurements) -> None:
        """Write measurements into the registers."""
        counted = (measured.position - decode_sign_magnitude(servo.get("homing_offset"), OFFSET_SIGN)) % TURN
        servo.put("present_position", counted)
        servo.put("present_speed", encode_sign_magnitude(measured.speed / TICK, POSITION_SIGN))
        servo.put("present_load", encode_sign_magnitude(measured.effort * THOUSAND, LOAD_SIGN, THOUSAND))
        servo.put("present_voltage", round(measured.voltage / VOLT))
        servo.put("present_temperature", measured.degrees_celsius)
        servo.put("present_current", round(abs(measured.effort) * self.stall_current / CURRENT_UNIT))
        servo.put("moving", int(abs(measured.speed) > STILL))

    def overload(self, servo: "VirtualServo") -> tuple[float, float]:
        """Return the stall threshold as a share of the largest torque, and the tolerated duration [s]."""
        return servo.get("overload_torque") / HUNDRED, servo.get("protection_time") * PROTECTION_UNIT

    def power_on(self, servo: "VirtualServo") -> None:
        """Set the torque limit to its persistent value."""
        servo.put("torque_limit", servo.get("max_torque"))

    def error_byte(self, servo: "VirtualServo", error: Error) -> int:
        """Return the hardware error; this protocol does not report errors of instructions."""
        return servo.get("hardware_error")

    def answers(self, servo: "VirtualServo", instruction: int) -> bool:
        """Whether a servo answers an instruction at its status level."""
        return bool(servo.get("status_level")) or instruction in (Instruction.PING, Instruction.READ)


KIND = Sts3215()
