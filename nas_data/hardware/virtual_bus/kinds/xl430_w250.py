"""ROBOTIS XL430-W250, the servo of a Koch arm's shoulder; source of control table and units: e-manual, X series."""

import math
from typing import TYPE_CHECKING

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
from nas_data.hardware.virtual_bus.packet import Error
from nas_data.hardware.xl320.control_table import ControlTableEntry

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

TURN = 4096  # units of position in a turn
TICK = 2 * math.pi / TURN  # [rad]
RAM = 64  # first volatile address
SPEED_UNIT = 0.229 * 2 * math.pi / 60  # [rad/s]
ACCELERATION_UNIT = 214.577 * 2 * math.pi / 60**2  # [rad/s²], rev/min²
FULL = 885  # register value of full PWM
POSITION = 3  # operating mode in which the position limits hold


def decode_twos_complement(value: int, size: int) -> int:
    """Return the value of a two's complement register of `size` bytes."""
    return value - 256**size if value >> (8 * size - 1) else value


class XSeries(ServoSeries):
    """Positions are encoder counts plus the homing offset; derivative and integral gain have no effect."""

    tick = TICK
    baud = {  # noqa: RUF012
        0: 9600,
        1: 57_600,
        2: 115_200,
        3: 1_000_000,
        4: 2_000_000,
        5: 3_000_000,
        6: 4_000_000,
    }
    bits = {Reason.OVERLOAD: 32, Reason.OVERHEAT: 4, Reason.VOLTAGE: 1}  # noqa: RUF012
    unloads = "torque_enable"

    def __init__(
        self, model: int, gain: int, voltages: tuple[int, int], supply: float, torque: float, current: float
    ) -> None:
        """Describe a servo of the series.

        Args:
            model: Its model number.
            gain: Proportional gain at the factory, at which the stiffness equals the model's.
            voltages: Lowest and highest voltage [0.1 V].
            supply: Usual voltage [V].
            torque: Stall torque at that voltage [N m].
            current: Stall current at that voltage [A].
        """
        self.registers = {register.name: register for register in _make_control_table(model, gain, voltages)}
        self.supply, self.stall_torque, self.stall_current, self._gain = supply, torque, current, gain

    def is_persistent(self, register: ControlTableEntry) -> bool:
        """Whether a register survives a loss of power."""
        return register.address < RAM

    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """Return the drive state that the registers define."""
        speed, acceleration = servo.get("profile_velocity"), servo.get("profile_acceleration")
        return ServoDrive(
            powered=bool(servo.get("torque_enable")),
            goal=decode_twos_complement(servo.get("goal_position"), 4)
            - decode_twos_complement(servo.get("homing_offset"), 4),
            speed=speed * SPEED_UNIT if speed else math.inf,
            acceleration=acceleration * ACCELERATION_UNIT if acceleration else math.inf,
            stiffness=servo.get("p_gain") / self._gain,
            strength=min(servo.get("pwm_limit"), servo.get("goal_pwm")) / FULL,
        )

    def sense(self, servo: "VirtualServo", measured: ServoMeasurements) -> None:
        """Write measurements into the registers."""
        offset = decode_twos_complement(servo.get("homing_offset"), 4)
        servo.put("present_position", (measured.position + offset) % 256**4)
        servo.put("present_speed", round(measured.speed / SPEED_UNIT) % 256**4)
        servo.put("present_pwm", round(measured.effort * FULL) % 256**2)
        servo.put("present_current", round(measured.effort * self.stall_current * 1000) % 256**2)
        servo.put("present_voltage", round(measured.voltage / VOLT))
        servo.put("present_temperature", measured.degrees_celsius)
        servo.put("moving", int(abs(measured.speed) > STILL))

    def check_write(self, servo: "VirtualServo", register: ControlTableEntry, value: int) -> Error:
        """Refuse goals beyond the position limits, and torque enable after a shutdown."""
        if register.name == "torque_enable" and value and servo.get("hardware_error") & servo.get("shutdown"):
            return Error.RESULT_FAIL
        if register.name != "goal_position" or servo.get("operating_mode") != POSITION:
            return Error.NONE
        within = servo.get("lowest_position") <= decode_twos_complement(value, 4) <= servo.get("highest_position")
        return Error.NONE if within else Error.DATA_LIMIT


def _make_control_table(model: int, gain: int, voltages: tuple[int, int]) -> tuple[ControlTableEntry, ...]:
    return (
        make_read_only("model_number", 0, 2, model),
        make_read_only("model_information", 2, 4),
        make_read_only("firmware", 6, 1, 45),
        make_register("id", 7, 1, 1, 252),
        make_register("baud_rate", 8, 1, 3, 6),
        make_register("return_delay", 9, 1, 250, 254),
        make_register("drive_mode", 10, 1, 0, 13),
        make_register("operating_mode", 11, 1, POSITION, 16),
        make_register("secondary_id", 12, 1, 255),
        make_register("protocol_type", 13, 1, 2, 2),
        make_register("homing_offset", 20, 4),
        make_register("moving_threshold", 24, 4, 10),
        make_register("temperature_limit", 31, 1, 72, 100),
        make_register("highest_voltage", 32, 2, voltages[1]),
        make_register("lowest_voltage", 34, 2, voltages[0]),
        make_register("pwm_limit", 36, 2, FULL, FULL),
        make_register("current_limit", 38, 2, 1750),
        make_register("acceleration_limit", 40, 4, 32_767),
        make_register("velocity_limit", 44, 4, 265),
        make_register("highest_position", 48, 4, TURN - 1),
        make_register("lowest_position", 52, 4),
        make_register("shutdown", 63, 1, 52),
        make_register("torque_enable", 64, 1, 0, 1),
        make_register("led", 65, 1, 0, 1),
        make_register("status_level", 68, 1, 2, 2),
        make_read_only("registered", 69),
        make_read_only("hardware_error", 70),
        make_register("velocity_i_gain", 76, 2, 1000),
        make_register("velocity_p_gain", 78, 2, 100),
        make_register("d_gain", 80, 2),
        make_register("i_gain", 82, 2),
        make_register("p_gain", 84, 2, gain, 16_383),
        make_register("feedforward_2nd_gain", 88, 2),
        make_register("feedforward_1st_gain", 90, 2),
        make_register("bus_watchdog", 98, 1),
        make_register("goal_pwm", 100, 2, FULL),
        make_register("goal_current", 102, 2, 1750),
        make_register("goal_velocity", 104, 4),
        make_register("profile_acceleration", 108, 4),
        make_register("profile_velocity", 112, 4),
        make_register("goal_position", 116, 4),
        make_read_only("realtime_tick", 120, 2),
        make_read_only("moving", 122),
        make_read_only("moving_status", 123),
        make_read_only("present_pwm", 124, 2),
        make_read_only("present_current", 126, 2),
        make_read_only("present_speed", 128, 4),
        make_read_only("present_position", 132, 4),
        make_read_only("velocity_trajectory", 136, 4),
        make_read_only("position_trajectory", 140, 4),
        make_read_only("present_voltage", 144, 2),
        make_read_only("present_temperature", 146, 1, 25),
    )


KIND = XSeries(model=1060, gain=800, voltages=(60, 140), supply=12.0, torque=1.5, current=1.4)
