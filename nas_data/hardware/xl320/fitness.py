"""Checks before an arm moves: supply, errors and temperature of its servos, and positions of its joints."""

import numpy as np

from nas_data.errors import OutsideLimits, ServoHot, ServoOverloaded, SupplyLow
from nas_data.hardware.arms.base import Health
from nas_data.hardware.xl320.control_table import OVERHEAT, OVERLOAD, VOLTAGE
from nas_data.hardware.xl320.joints import Joints

LOWEST_VOLTAGE = 6.0  # [V] lowest specified voltage of an XL-320; e-manual
MARGIN = 0.05  # [rad] tolerated initial position beyond a limit: ten ticks of play and sag
COOL = 50  # [°C] to which an overheated servo must cool down


def refuse_unfit(name: str, health: Health) -> None:
    """Refuse a servo that has shut down or has a low supply voltage.

    Args:
        name: Name of the servo in errors.
        health: Its health.

    Raises:
        SupplyLow: the voltage is below 6 V, or the servo reported a voltage error.
        ServoHot, ServoOverloaded: it shut down for that reason.
    """
    again = "then clear it (nas robot ergojr --port PORT --reboot)."
    if health.errors & OVERHEAT:
        raise ServoHot(f"{name} shut down at {health.temperature} °C; let it cool below {COOL} °C, {again}")
    if health.errors & OVERLOAD:
        raise ServoOverloaded(f"{name} shut down by overload; free what blocks it, {again}")
    if health.voltage < LOWEST_VOLTAGE:
        raise SupplyLow(
            f"{name} gets {health.voltage:.1f} V; an XL-320 needs 6 V: charge or exchange the supply (7.4 V)."
        )
    if health.errors & VOLTAGE:
        raise SupplyLow(f"{name} had a voltage out of its range; check the supply (7.4 V), {again}")


def refuse_outside(joints: Joints, positions: np.ndarray) -> None:
    """Refuse positions [rad], shape (n,), outside the limits: a first command could cause a collision.

    Raises:
        OutsideLimits: a joint is outside its limits.
    """
    for joint, position, low, high in zip(joints.names, positions, joints.low, joints.high, strict=True):
        if not low - MARGIN <= position <= high + MARGIN:
            raise OutsideLimits(
                f"{joint} stands at {np.degrees(position):.0f}°, outside {np.degrees(low):.0f} … "
                f"{np.degrees(high):.0f}°; move it there by hand (the torque is off), or calibrate the arm."
            )
