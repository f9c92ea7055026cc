"""The control table of the XL-320: addresses, ranges and initial values of the registers, and their units.

Source: ROBOTIS e-manual, XL-320: position 0 … 1023 over 300°, speed 0.111 rpm, load 0.1 %, voltage 0.1 V, temperature
1 °C, return delay 2 µs.
"""

import math
from dataclasses import dataclass

import numpy as np

TICK = math.radians(300 / 1023)  # [rad] a unit of position
CENTRE = 512  # position in the middle of the range
HIGHEST = 1023
SPEED_UNIT = 0.111 * 2 * math.pi / 60  # [rad/s] a unit of speed
LOAD_UNIT = 1e-3  # share of the largest torque
VOLT = 0.1  # [V] a unit of voltage
DELAY_UNIT = 2e-6  # [s] a unit of return delay
SIGN = 0x400  # sign bit, set for clockwise; the ten lower bits are the magnitude


def decode_sign_magnitude(raw: np.ndarray) -> np.ndarray:
    """Return the values of sign-magnitude registers (speed, load), positive counterclockwise, any shape."""
    magnitude = raw & (SIGN - 1)
    return np.where(raw & SIGN, -magnitude, magnitude)


def encode_sign_magnitude(value: float) -> int:
    """Return a number, rounded and limited to ten bits, as the value of a sign-magnitude register."""
    magnitude = min(SIGN - 1, round(abs(value)))
    return magnitude | SIGN if value < 0 and magnitude else magnitude


def encode_speed_limit(speed: float) -> int:
    """Return the moving speed register for a speed limit [rad/s]: at least 1, because 0 means unlimited."""
    return int(np.clip(round(speed / SPEED_UNIT), 1, SIGN - 1))


MODEL_NUMBER = 350
SIZE = 53  # bytes, including the last register
RAM = 24  # first volatile address; registers below are locked while the torque is on
FEEDBACK = 37  # address of position, speed and load, which are consecutive
FEEDBACK_SIZE = 6
HEALTH = 45  # address of voltage and temperature, five bytes before the hardware error
HEALTH_SIZE = 6

OVERLOAD, OVERHEAT, VOLTAGE = 1, 2, 4  # bits of the registers hardware_error and shutdown


@dataclass(frozen=True)
class ControlTableEntry:
    """One entry of the control table."""

    name: str  # its name in this package
    address: int  # first byte
    size: int  # bytes, little endian
    initial: int  # factory setting
    low: int = 0  # smallest writable value
    high: int = 255  # largest writable value
    writable: bool = True  # whether it can be written


REGISTERS = {
    register.name: register
    for register in (
        ControlTableEntry("model_number", 0, 2, MODEL_NUMBER, writable=False),
        ControlTableEntry("firmware", 2, 1, 29, writable=False),
        ControlTableEntry("id", 3, 1, 1, 0, 252),
        ControlTableEntry("baud_rate", 4, 1, 3, 0, 3),
        ControlTableEntry("return_delay", 5, 1, 250, 0, 254),
        ControlTableEntry("cw_limit", 6, 2, 0, 0, 1023),
        ControlTableEntry("ccw_limit", 8, 2, 1023, 0, 1023),
        ControlTableEntry("control_mode", 11, 1, 2, 1, 2),
        ControlTableEntry("temperature_limit", 12, 1, 65, 0, 150),
        ControlTableEntry("lowest_voltage", 13, 1, 60, 50, 250),
        ControlTableEntry("highest_voltage", 14, 1, 90, 50, 250),
        ControlTableEntry("max_torque", 15, 2, 1023, 0, 1023),
        ControlTableEntry("status_level", 17, 1, 2, 0, 2),
        ControlTableEntry("shutdown", 18, 1, 3, 0, 7),
        ControlTableEntry("torque_enable", 24, 1, 0, 0, 1),
        ControlTableEntry("led", 25, 1, 0, 0, 7),
        ControlTableEntry("d_gain", 27, 1, 0, 0, 254),
        ControlTableEntry("i_gain", 28, 1, 0, 0, 254),
        ControlTableEntry("p_gain", 29, 1, 32, 0, 254),
        ControlTableEntry("goal_position", 30, 2, 512, 0, 1023),
        ControlTableEntry("moving_speed", 32, 2, 0, 0, 2047),
        ControlTableEntry("torque_limit", 35, 2, 1023, 0, 1023),
        ControlTableEntry("present_position", 37, 2, 512, writable=False),
        ControlTableEntry("present_speed", 39, 2, 0, writable=False),
        ControlTableEntry("present_load", 41, 2, 0, writable=False),
        ControlTableEntry("present_voltage", 45, 1, 74, writable=False),
        ControlTableEntry("present_temperature", 46, 1, 25, writable=False),
        ControlTableEntry("registered", 47, 1, 0, writable=False),
        ControlTableEntry("moving", 49, 1, 0, writable=False),
        ControlTableEntry("hardware_error", 50, 1, 0, writable=False),
        ControlTableEntry("punch", 51, 2, 32, 0, 1023),
    )
}
NOT_SETTINGS = ("registered", "moving", "hardware_error", "goal_position", "led")  # registers that are no settings
SETTINGS = tuple(r for r in REGISTERS.values() if not r.name.startswith("present") and r.name not in NOT_SETTINGS)
