"""Safe stop of an arm: hold it until it is slow, switch the torque off, and verify that on each servo."""

import contextlib
import importlib
import time
from collections.abc import Mapping
from typing import Protocol, cast

import numpy as np

from nas_data.errors import ArmError

SLOW = 0.15  # [rad/s] below which switching the torque off causes no jerk
PATIENCE = 1.0  # [s] to wait for that speed
OPENER = "opener"  # key of the function that opens the arm, as `module:function`


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
        return f"The torque could not be switched off; switch the supply off. {error}"
    unconfirmed = [str(identity) for identity in arm.find_unconfirmed()]
    if unconfirmed:
        return f"Servo {', '.join(unconfirmed)} did not confirm that its torque is off; switch the supply off."
    return ""


def open_for_guard(options: Mapping[str, object]) -> Stoppable:
    """Open an arm in order to stop it.

    Args:
        options: Under `opener` a function as `module:function`; the other entries are its arguments.

    Raises:
        ArmError: the port cannot be opened.
    """
    module, _, name = str(options[OPENER]).partition(":")
    opener = getattr(importlib.import_module(module), name)
    return cast(Stoppable, opener(**{key: value for key, value in options.items() if key != OPENER}))
