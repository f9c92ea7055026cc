"""Interface between recorders and arms of servos, whichever protocol they use, and the safe stop of an arm."""

import contextlib
import importlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np

from nas_data.errors import ArmError

SLOW = 0.15  # [rad/s] below which switching the torque off causes no jerk
PATIENCE = 1.0  # [s] to wait for that speed


class Stoppable(Protocol):
    """Interface for a safe stop; its methods raise ArmError if the bus fails."""

    def read_position(self) -> np.ndarray:
        """Return the present position in the units of `hold`, shape (n,)."""

    def hold(self, position: np.ndarray) -> None:
        """Command a position, shape (n,)."""

    def speed(self) -> float:
        """Return the speed of the fastest joint [rad/s]."""

    def torque_off(self) -> None:
        """Switch the torque off at once, even in motion."""

    def find_unconfirmed(self) -> list[int]:
        """Return the IDs of servos that do not confirm that their torque is off."""

    def close(self) -> None:
        """Close the port."""


def make_safe(arm: Stoppable) -> str:
    """Hold the arm, wait until it is slow, and switch its torque off.

    Returns:
        A sentence on what failed; empty if nothing did.
    """
    with contextlib.suppress(ArmError):  # a failure here is reported elsewhere or below
        until, here = time.monotonic() + PATIENCE, arm.read_position()
        arm.hold(here)
        while time.monotonic() < until and arm.speed() > SLOW:
            arm.hold(here)
            time.sleep(0.01)
    try:
        arm.torque_off()
    except ArmError as error:
        return f"The torque could not be switched off; switch the power supply off. {error}"
    unconfirmed = [str(identity) for identity in arm.find_unconfirmed()]
    if unconfirmed:
        return f"Servo {', '.join(unconfirmed)} did not confirm that its torque is off; switch the supply off."
    return ""


@dataclass(frozen=True)
class ArmOpener:
    """What another process, the watchdog, needs to open an arm and stop it; both fields can be written as JSON."""

    function: str  # the function that opens the arm, as `module:function`
    arguments: Mapping[str, object]  # its arguments

    def open(self) -> Stoppable:
        """Open the arm.

        Raises:
            ArmError: the port cannot be opened.
        """
        module, _, name = self.function.partition(":")
        return cast(Stoppable, getattr(importlib.import_module(module), name)(**self.arguments))


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
    """An open arm; its methods raise `ArmError`."""

    retries: int  # readings that needed more than one attempt

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

    def opener(self) -> ArmOpener:
        """Return how the watchdog opens the arm."""
