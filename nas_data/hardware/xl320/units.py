"""Units of the XL-320's registers.

Source: ROBOTIS e-manual, XL-320: position 0 … 1023 over 300°, speed 0.111 rpm, load 0.1 %, voltage 0.1 V, temperature
1 °C, return delay 2 µs.
"""

import math

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
