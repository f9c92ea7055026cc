"""Units of the XL-320's registers: what is a number there is radians, radians a second, volts or a share here.

Source: ROBOTIS e-manual, XL-320: 0 … 1023 over 300°, 0.111 rpm a unit of speed, 0.1 % a unit of load, 0.1 V,
1 °C, 2 µs.
"""

import math

import numpy as np

TICK = math.radians(300 / 1023)  # [rad] a unit of position
CENTRE = 512  # position at which the horn stands in the middle
HIGHEST = 1023
SPEED_UNIT = 0.111 * 2 * math.pi / 60  # [rad/s] a unit of speed
LOAD_UNIT = 1e-3  # share of the largest torque
VOLT = 0.1  # [V] a unit of voltage
DELAY_UNIT = 2e-6  # [s] a unit of return delay
SIGN = 0x400  # bit that says clockwise; the ten below hold the magnitude


def decode_sign_magnitude(raw: np.ndarray) -> np.ndarray:
    """Return what sign-magnitude registers (speed, load) say, counterclockwise positive; any shape."""
    magnitude = raw & (SIGN - 1)
    return np.where(raw & SIGN, -magnitude, magnitude)


def sign_magnitude(value: float) -> int:
    """Return a number of units, rounded and limited to ten bits, as a sign-magnitude register holds it."""
    magnitude = min(SIGN - 1, round(abs(value)))
    return magnitude | SIGN if value < 0 and magnitude else magnitude


def speed_units(speed: float) -> int:
    """Return a speed limit [rad/s] as the moving speed register holds it: at least 1, because 0 means unlimited."""
    return int(np.clip(round(speed / SPEED_UNIT), 1, SIGN - 1))
