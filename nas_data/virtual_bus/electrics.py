"""What current does to a servo's supply, its temperature and its patience.

The stall current is the e-manual's; the resistances to heat and of the supply are plausible, not measured.
"""

from dataclasses import dataclass, field

import numpy as np

from nas_data.xl320.control_table import OVERHEAT, OVERLOAD, VOLTAGE

STALL_CURRENT = 1.1  # [A] at 7.4 V, XL-320 e-manual
IDLE_CURRENT = 0.03  # [A] of a servo that stands
SUPPLY_RESISTANCE = 0.15  # [Ω] of supply and wires
HEATING = 12.0  # [K/W] above the air, once warm
WARMING = 240.0  # [s] until two thirds of that
OVERLOAD_SHARE = 0.95  # share of the largest torque that counts as stalled
OVERLOAD_SECONDS = 2.0  # [s] of it after which the servo gives up


@dataclass
class Electrics:
    """Supply and warmth of n servos.

    Attributes:
        supply: Voltage without load [V].
        air: Temperature around the arm [°C].
        voltage: Voltage at the servos [V].
        temperature: Of each servo [°C], shape (n,).
    """

    count: int
    supply: float = 7.4
    air: float = 25.0
    voltage: float = field(init=False)
    temperature: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.voltage = self.supply
        self.temperature = np.full(self.count, self.air)
        self._strained: np.ndarray = np.zeros(self.count)

    def advance(self, duty: np.ndarray, seconds: float) -> None:
        """Let time pass under the servos' duty (share of their largest torque, shape (n,), signed)."""
        current = IDLE_CURRENT + STALL_CURRENT * np.abs(duty)
        self.voltage = max(0.0, self.supply - SUPPLY_RESISTANCE * float(current.sum()))
        warm = self.air + HEATING * self.voltage * STALL_CURRENT * np.square(duty)
        self.temperature += (warm - self.temperature) * min(1.0, seconds / WARMING)
        strained = np.abs(duty) >= OVERLOAD_SHARE
        self._strained = np.where(strained, self._strained + seconds, 0.0)

    def errors(self, lowest: np.ndarray, highest: np.ndarray, hottest: np.ndarray) -> np.ndarray:
        """Return the bits of the hardware error of each servo.

        Args:
            lowest: Lowest voltage [V], shape (n,).
            highest: Highest voltage [V], shape (n,).
            hottest: Highest temperature [°C], shape (n,).
        """
        found = np.where(self._strained > OVERLOAD_SECONDS, OVERLOAD, 0)
        found |= np.where(self.temperature > hottest, OVERHEAT, 0)
        return np.asarray(found | np.where((self.voltage < lowest) | (self.voltage > highest), VOLTAGE, 0))
