"""Interface between recorders and arms of servos, whichever protocol they use."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nas_data.hardware.arms.safety import Stoppable

Registers = Mapping[str, Mapping[str, int]]  # by joint, then by the register's name


@dataclass(frozen=True)
class Reading:
    """The state of the arm at one moment."""

    time: float  # monotonic time, midway between request and last reply [s]
    positions: np.ndarray  # [rad], shape (n,)
    velocities: np.ndarray  # [rad/s], shape (n,)
    loads: np.ndarray  # shares of the largest torque, shape (n,)
    raw: bytes  # replies of the servos, as bytes
    alerts: tuple[int, ...]  # IDs of servos with a hardware error
    goals: np.ndarray | None = None  # active commands [rad], shape (n,); None if the servos do not report them


@dataclass(frozen=True)
class Health:
    """Health of one servo."""

    voltage: float  # supply voltage [V]
    temperature: int  # internal temperature [°C]
    errors: int  # bits of the hardware error register


class Arm(Stoppable, Protocol):
    """An open arm; its methods raise `ArmError`.

    Attributes:
        names: Names of the joints.
        retries: Readings that needed more than one attempt.
    """

    retries: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""

    def check(self) -> object:
        """Check every servo, and refuse an arm that cannot be used; nothing moves."""

    def configure(self) -> None:
        """Write the settings of every servo."""

    def torque_on(self) -> None:
        """Switch the torque on with the present pose as the goal."""

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad], shape (n,); return them as sent."""

    def read(self) -> Reading:
        """Read all servos."""

    def refuse_alerts(self, reading: Reading) -> None:
        """Raise ArmError if a servo has shut down, with the reason."""

    def check_servo(self, index: int) -> Health:
        """Read the health of the servo of joint `index`; raise ArmError if it must not be used."""

    def registers(self) -> Registers:
        """Read the settings of every servo from its control table."""

    def describe(self) -> dict[str, object]:
        """Return the description of the hardware for provenance."""


class Driver(Protocol):
    """Opens an arm."""

    @property
    def port(self) -> str:
        """Path of the port."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""

    @property
    def speed(self) -> float:
        """Speed limit of the servos [rad/s]; 0 for none."""

    def open(self, now: Callable[[], float]) -> Arm:
        """Open the port; the clock [s] stamps the readings."""

    def guard_options(self) -> dict[str, object]:
        """Return the options of `safety.open_for_guard`, with which the watchdog opens the arm."""
