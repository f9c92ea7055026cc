"""Supply voltage, temperature and overload of servos as functions of their current.

Stall currents are from the manuals; thermal resistance and supply resistance are plausible values, not measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.hardware.virtual_bus.kinds.base import Bounds, Reason, ServoSeries

IDLE_CURRENT = 0.03  # [A] of a servo without load
SUPPLY_RESISTANCE = 0.15  # [Ω] of supply and wires
HEATING = 12.0  # [K/W] thermal resistance to the air
WARMING = 240.0  # [s] thermal time constant


@dataclass
class Electrics:
    """Voltages and temperatures of n servos."""

    kinds: Sequence[ServoSeries]  # series of each servo
    air: float = 25.0  # ambient temperature [°C]
    supply: np.ndarray | float = field(init=False)  # voltage of each servo without load [V], shape (n,), or one for all
    voltage: np.ndarray | float = field(init=False)  # voltage of each servo [V], shape (n,), or one for all
    temperature: np.ndarray = field(init=False)  # temperature of each servo [°C], shape (n,)

    def __post_init__(self) -> None:
        self.supply = self.voltage = np.array([kind.supply for kind in self.kinds])
        self.temperature = np.full(len(self.kinds), self.air)
        self._stall = np.array([kind.stall_current for kind in self.kinds])
        self._strained: np.ndarray = np.zeros(len(self.kinds))

    def advance(self, duty: np.ndarray, strain: np.ndarray, seconds: float) -> None:
        """Advance voltages, temperatures and stall times.

        Args:
            duty: Signed share of the largest torque of each servo, shape (n,).
            strain: Duty above which each servo counts as stalled, shape (n,).
            seconds: Time step [s].
        """
        current = IDLE_CURRENT + self._stall * np.abs(duty)
        self.voltage = np.maximum(0.0, self.supply - SUPPLY_RESISTANCE * float(current.sum()))
        warm = self.air + HEATING * self.voltage * self._stall * np.square(duty)
        self.temperature += (warm - self.temperature) * min(1.0, seconds / WARMING)
        self._strained = np.where(np.abs(duty) >= strain, self._strained + seconds, 0.0)

    def volts(self, index: int) -> float:
        """Return the voltage at one servo [V]."""
        return float(np.broadcast_to(self.voltage, len(self.kinds))[index])

    def reasons(self, index: int, bounds: Bounds) -> Reason:
        """Return the reasons for which a servo must shut down."""
        found = Reason(0)
        if self._strained[index] > bounds.seconds:
            found |= Reason.OVERLOAD
        if self.temperature[index] > bounds.hottest:
            found |= Reason.OVERHEAT
        if not bounds.lowest <= self.volts(index) <= bounds.highest:
            found |= Reason.VOLTAGE
        return found
