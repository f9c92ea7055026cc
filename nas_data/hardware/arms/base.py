"""What a recorder needs of an arm of servos, whichever protocol they speak."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nas_data.hardware.arms.safety import Stoppable

Registers = Mapping[str, Mapping[str, int]]  # by joint, then by the register's name


@dataclass(frozen=True)
class Reading:
    """The state of the arm at one moment.

    Attributes:
        time: Monotonic clock, the middle between question and last answer [s].
        positions: [rad], shape (n,).
        velocities: [rad/s], shape (n,).
        loads: Shares of the largest torque, shape (n,).
        raw: What the servos said, byte for byte.
        alerts: Identities of servos with a hardware error.
        goals: Commands that the servos hold at that moment [rad], shape (n,); None where they are not read back.
    """

    time: float
    positions: np.ndarray
    velocities: np.ndarray
    loads: np.ndarray
    raw: bytes
    alerts: tuple[int, ...]
    goals: np.ndarray | None = None


@dataclass(frozen=True)
class Health:
    """What is read now and then of one servo.

    Attributes:
        voltage: At its supply [V].
        temperature: Inside [°C].
        errors: Bits of the hardware error, as its control table has them.
    """

    voltage: float
    temperature: int
    errors: int


class Arm(Stoppable, Protocol):
    """An open arm; what goes wrong with it is an `ArmError`.

    Attributes:
        names: Of its joints.
        retries: Readings that needed more than one attempt.
    """

    retries: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""

    def check(self) -> object:
        """Look at every servo, and refuse an arm that cannot be used; nothing moves."""

    def configure(self) -> None:
        """Set every servo up."""

    def torque_on(self) -> None:
        """Switch the torque on where the arm stands."""

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad], shape (n,); return them as they were sent."""

    def read(self) -> Reading:
        """Read the arm."""

    def refuse_alerts(self, reading: Reading) -> None:
        """Say why a servo has shut down, where one has."""

    def look_after(self, place: int) -> Health:
        """Read supply and warmth of the servo of one joint, and refuse one that must not be used."""

    def registers(self) -> Registers:
        """Read the settings of every servo, as its control table holds them."""

    def describe(self) -> dict[str, object]:
        """Return what provenance records about the hardware."""


class Driver(Protocol):
    """How to open an arm."""

    @property
    def port(self) -> str:
        """Where it is."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its joints."""

    @property
    def speed(self) -> float:
        """Speed that its servos are limited to [rad/s]; 0 for none."""

    def open(self, now: Callable[[], float]) -> Arm:
        """Open the port; the clock [s] stamps the readings."""

    def charge(self) -> dict[str, object]:
        """Return what a guard needs in order to stop the arm; see `nas_data.hardware.arms.safety`."""
