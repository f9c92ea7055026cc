"""How an arm is left: held until it is slow, then without torque, each servo asked whether it is."""

import contextlib
import importlib
import time
from collections.abc import Mapping
from typing import Protocol, cast

import numpy as np

from nas_data.errors import ArmError

SLOW = 0.15  # [rad/s] below which the torque may go without a jerk
PATIENCE = 1.0  # [s] to wait for that
OPENER = "opener"  # what a charge calls the function that opens the arm, as `module:function`


class Stoppable(Protocol):
    """What can be made safe; its methods raise ArmError where the line fails."""

    def where(self) -> np.ndarray:
        """Return where the arm stands, as `stay` takes it, shape (n,)."""

    def stay(self, there: np.ndarray) -> None:
        """Command the arm to stay somewhere."""

    def speed(self) -> float:
        """Return the speed of the fastest joint [rad/s]."""

    def torque_off(self) -> None:
        """Switch the torque off at once, whatever moves."""

    def unsure(self) -> list[int]:
        """Return the servos that do not confirm that their torque is off."""

    def close(self) -> None:
        """Give the port back."""


def make_safe(arm: Stoppable) -> str:
    """Hold the arm where it is, wait until it is slow, switch the torque off; return what could not be done."""
    with contextlib.suppress(ArmError):  # what keeps the arm from being read has been said, or is said below
        until, here = time.monotonic() + PATIENCE, arm.where()
        arm.stay(here)
        while time.monotonic() < until and arm.speed() > SLOW:
            arm.stay(here)
            time.sleep(0.01)
    try:
        arm.torque_off()
    except ArmError as error:
        return f"The torque could not be switched off; switch the supply off. {error}"
    unsure = [str(identity) for identity in arm.unsure()]
    if unsure:
        return f"Servo {', '.join(unsure)} did not confirm that its torque is off; switch the supply off."
    return ""


def open_charge(charge: Mapping[str, object]) -> Stoppable:
    """Open the arm that a guard was told of.

    Args:
        charge: Under `opener` a function as `module:function`; the rest are its arguments.

    Raises:
        ArmError: the port cannot be opened.
    """
    module, _, name = str(charge[OPENER]).partition(":")
    opener = getattr(importlib.import_module(module), name)
    return cast(Stoppable, opener(**{key: value for key, value in charge.items() if key != OPENER}))
