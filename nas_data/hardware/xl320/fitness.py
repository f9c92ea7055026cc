"""Whether an arm may be moved: supply, errors and warmth of its servos, and where its joints stand."""

import numpy as np

from nas_data.errors import OutsideLimits, ServoHot, ServoOverloaded, SupplyLow
from nas_data.hardware.arms.base import Health
from nas_data.hardware.xl320.control_table import OVERHEAT, OVERLOAD, VOLTAGE
from nas_data.hardware.xl320.joints import Joints

LOWEST_VOLTAGE = 6.0  # [V] below which an XL-320 is not specified; e-manual
MARGIN = 0.05  # [rad] by which a joint may stand beyond its limits at the start: ten ticks of play and sag
COOL = 50  # [°C] at which a servo that was too hot may go on


def refuse_unfit(name: str, health: Health) -> None:
    """Refuse a servo that shut down or has too little voltage.

    Args:
        name: What to call the servo.
        health: What it says.

    Raises:
        SupplyLow: less than 6 V, or the servo noticed a voltage out of its range.
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
    """Refuse positions [rad], shape (n,), beyond the limits: a first command would pull the arm through what is there.

    Raises:
        OutsideLimits: a joint stands outside.
    """
    for joint, position, low, high in zip(joints.names, positions, joints.low, joints.high, strict=True):
        if not low - MARGIN <= position <= high + MARGIN:
            raise OutsideLimits(
                f"{joint} stands at {np.degrees(position):.0f}°, outside {np.degrees(low):.0f} … "
                f"{np.degrees(high):.0f}°; move it there by hand (the torque is off), or calibrate the arm."
            )
