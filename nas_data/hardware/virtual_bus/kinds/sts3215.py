"""Feetech STS3215 (7.4 V), the servo of the SO-100 and SO-101.

Sources: Feetech, memory table of the STS series, as LeRobot's `motors/feetech/tables.py` has it, and the data sheet
of the STS3215-C001. What a servo does at the highest acceleration, with an integral part and below its minimum start
force is not documented: there the acceleration is taken to be unlimited, and the other two to do nothing.
"""

import math
from typing import TYPE_CHECKING

from nas_data.hardware.virtual_bus.kinds.base import STILL, VOLT, Reason, Sensation, ServoDrive, ServoSeries
from nas_data.hardware.virtual_bus.packet import Error, Instruction
from nas_data.hardware.virtual_bus.protocols import FEETECH
from nas_data.hardware.xl320.control_table import ControlTableEntry

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

TURN = 4096  # units of position in a turn
TICK = 2 * math.pi / TURN  # [rad]
GAIN = 16  # value of the P register at which the servo is as stiff as the model: what LeRobot sets
ACCELERATION_UNIT = 100 * TICK  # [rad/s²]
FASTEST = 254  # value of the acceleration that is taken for none
CURRENT_UNIT, PROTECTION_UNIT = 0.0065, 0.01  # [A], [s]
THOUSAND, HUNDRED = 1000, 100  # the whole of a torque or a load, and of a protection's torque
RAM, FACTORY = 40, 80  # addresses between which a loss of power forgets
POSITION_SIGN, OFFSET_SIGN, LOAD_SIGN = 15, 11, 10  # bits that say minus


def _register(name: str, address: int, size: int = 1, initial: int = 0, high: int | None = None) -> ControlTableEntry:
    return ControlTableEntry(name, address, size, initial, 0, 256**size - 1 if high is None else high)


def _read_only(name: str, address: int, size: int = 1, initial: int = 0) -> ControlTableEntry:
    return ControlTableEntry(name, address, size, initial, 0, 256**size - 1, writable=False)


REGISTERS = {
    register.name: register
    for register in (
        _read_only("firmware_major", 0, initial=3),
        _read_only("firmware_minor", 1, initial=10),
        _read_only("model_number", 3, 2, 777),
        _register("id", 5, initial=1, high=253),
        _register("baud_rate", 6, high=7),
        _register("return_delay", 7, initial=250, high=254),
        _register("status_level", 8, initial=1, high=1),
        _register("lowest_position", 9, 2, high=TURN - 1),
        _register("highest_position", 11, 2, TURN - 1, TURN - 1),
        _register("temperature_limit", 13, initial=70, high=100),
        _register("highest_voltage", 14, initial=80, high=254),
        _register("lowest_voltage", 15, initial=40, high=254),
        _register("max_torque", 16, 2, THOUSAND, THOUSAND),
        _register("phase", 18, initial=12),
        _register("unloading", 19, initial=44, high=254),
        _register("alarm", 20, initial=47, high=254),
        _register("p_gain", 21, initial=32, high=254),
        _register("d_gain", 22, initial=32, high=254),
        _register("i_gain", 23, high=254),
        _register("start_force", 24, 2, 16, THOUSAND),
        _register("cw_dead_zone", 26, initial=1, high=32),
        _register("ccw_dead_zone", 27, initial=1, high=32),
        _register("protection_current", 28, 2, 500, 511),
        _register("resolution", 30, initial=1, high=3),
        _register("homing_offset", 31, 2, high=2 * TURN - 1),
        _register("operating_mode", 33, high=3),
        _register("protective_torque", 34, initial=20, high=HUNDRED),
        _register("protection_time", 35, initial=200, high=254),
        _register("overload_torque", 36, initial=80, high=HUNDRED),
        _register("velocity_p_gain", 37, initial=10, high=100),
        _register("overcurrent_time", 38, initial=200, high=254),
        _register("velocity_i_gain", 39, initial=10, high=254),
        _register("torque_enable", 40, high=128),
        _register("acceleration", 41, high=254),
        _register("goal_position", 42, 2),
        _register("goal_time", 44, 2),
        _register("goal_speed", 46, 2),
        _register("torque_limit", 48, 2, THOUSAND, THOUSAND),
        _register("lock", 55, initial=1, high=1),
        _read_only("present_position", 56, 2),
        _read_only("present_speed", 58, 2),
        _read_only("present_load", 60, 2),
        _read_only("present_voltage", 62, initial=74),
        _read_only("present_temperature", 63, initial=25),
        _read_only("registered", 64),
        _read_only("hardware_error", 65),
        _read_only("moving", 66),
        _read_only("present_current", 69, 2),
        _read_only("goal_position_2", 71, 2),
        _register("moving_threshold", 80, initial=1),
        _register("time_step", 81, initial=32),
        _register("velocity_unit", 82, initial=1),
        _register("half_time_step", 83),
        _register("maximum_velocity", 84, initial=40),
        _register("maximum_acceleration", 85, initial=50, high=254),
        _register("acceleration_multiplier", 86, initial=1),
    )
}


def decode_sign_magnitude(value: int, bit: int) -> int:
    """Return what a sign-magnitude register says."""
    magnitude = value & ((1 << bit) - 1)
    return -magnitude if value >> bit & 1 else magnitude


def magnitude(value: float, bit: int, highest: int | None = None) -> int:
    """Return a number, rounded, as a sign-magnitude register holds it."""
    most = (1 << bit) - 1 if highest is None else highest
    return min(most, round(abs(value))) | ((1 << bit) if value < 0 else 0)


class Sts3215(ServoSeries):
    """Positions are encoder counts less the homing offset, speeds counts a second."""

    registers = REGISTERS
    tick = TICK
    supply = 7.4
    stall_current = 2.4  # [A]
    stall_torque = 1.91  # [N m], 19.5 kg cm
    baud = dict(enumerate((1_000_000, 500_000, 250_000, 128_000, 115_200, 57_600, 38_400, 19_200)))  # noqa: RUF012
    bits = {Reason.OVERLOAD: 32, Reason.OVERHEAT: 4, Reason.VOLTAGE: 1}  # noqa: RUF012
    protocol = FEETECH

    def lasts(self, register: ControlTableEntry) -> bool:
        """See `ServoSeries.lasts`."""
        return register.address < RAM or register.address >= FACTORY

    def locked(self, servo: "VirtualServo", register: ControlTableEntry) -> bool:
        """Refuse nothing: the lock keeps a value from outliving the power, not from being written."""
        return False

    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """See `ServoSeries.drive`; goals beyond the limits are cut."""
        goal = decode_sign_magnitude(servo.get("goal_position"), POSITION_SIGN)
        low, high = servo.get("lowest_position"), servo.get("highest_position")
        speed, acceleration = decode_sign_magnitude(servo.get("goal_speed"), POSITION_SIGN), servo.get("acceleration")
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

    def sense(self, servo: "VirtualServo", felt: Sensation) -> None:
        """See `ServoSeries.sense`."""
        counted = (felt.position - decode_sign_magnitude(servo.get("homing_offset"), OFFSET_SIGN)) % TURN
        servo.put("present_position", counted)
        servo.put("present_speed", magnitude(felt.speed / TICK, POSITION_SIGN))
        servo.put("present_load", magnitude(felt.effort * THOUSAND, LOAD_SIGN, THOUSAND))
        servo.put("present_voltage", round(felt.voltage / VOLT))
        servo.put("present_temperature", felt.degrees_celsius)
        servo.put("present_current", round(abs(felt.effort) * self.stall_current / CURRENT_UNIT))
        servo.put("moving", int(abs(felt.speed) > STILL))

    def overload(self, servo: "VirtualServo") -> tuple[float, float]:
        """See `ServoSeries.overload`."""
        return servo.get("overload_torque") / HUNDRED, servo.get("protection_time") * PROTECTION_UNIT

    def started(self, servo: "VirtualServo") -> None:
        """Take the torque limit over from what lasts."""
        servo.put("torque_limit", servo.get("max_torque"))

    def error_byte(self, servo: "VirtualServo", error: Error) -> int:
        """Return the status: this protocol does not say why an instruction was not followed."""
        return servo.get("hardware_error")

    def answers(self, servo: "VirtualServo", instruction: int) -> bool:
        """See `ServoSeries.answers`."""
        return bool(servo.get("status_level")) or instruction in (Instruction.PING, Instruction.READ)


KIND = Sts3215()
