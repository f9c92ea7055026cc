"""An arm that may be moved: looked at first, guarded while its torque is on, left without torque whatever happens."""

import contextlib
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from nas_data.errors import GuardLost
from nas_data.hardware.arms.base import Driver
from nas_data.hardware.arms.safety import make_safe
from nas_data.recorders.arm_motion import ArmMotion
from nas_data.recorders.arm_ways import Ways
from nas_data.recorders.schedule import Clock
from nas_data.recorders.tolerance import TRIES, Tolerance
from nas_data.recorders.watchdog import Watchdog

SETTING_UP = 10.0  # [s] that it may take to look at an arm, to set it up or to make it safe
REST = 1.0  # [s] that a line has to recover


@dataclass(frozen=True, kw_only=True)
class Setup:
    """An arm, and how it is to be moved.

    Attributes:
        driver: How the arm is opened.
        ways: How it gets from pose to pose without touching anything.
        rate: Control rate [Hz].
        largest_step: By how much a command may differ from the one before [rad].
    """

    driver: Driver
    ways: Ways
    rate: float = 100.0
    largest_step: float = 3.2


class GuardedArm:
    """An arm and its guard; a context that leaves the arm without torque.

    Attributes:
        arm: The arm.
        doubt: After leaving: what could not be done to make the arm safe; empty where everything was.
    """

    def __init__(self, setup: Setup, clock: Clock, patience: float = 0.0) -> None:
        """Open the port and start the guard; nothing moves.

        Args:
            setup: The arm.
            clock: By which it is moved.
            patience: How long [s] whoever moves the arm may do something else between two readings.

        Raises:
            ArmError: the port cannot be opened.
        """
        self.arm = setup.driver.open(clock.now)
        self.doubt = ""
        self._setup, self._clock, self._patience = setup, clock, patience
        self._watchdog = Watchdog(setup.driver)
        self._beside: tuple[GuardedArm, ...] = ()

    def take(self, pose: np.ndarray) -> ArmMotion:
        """Look at the arm and for a way to its first pose [rad], shape (n,), set it up, switch its torque on.

        Where the line fails in a way that may pass, the arm is made safe, left alone for a moment, and taken again.

        Raises:
            ArmError: something is wrong with the arm.
        """
        return Tolerance(TRIES, self.recover).ask(lambda: self._take(pose))

    def recover(self) -> None:
        """Make the arm safe, and give its line time to recover."""
        self.make_safe()
        self._clock.wait_until(self._clock.now() + REST)

    def _take(self, pose: np.ndarray) -> ArmMotion:
        setup = self._setup
        self.promise(SETTING_UP)
        self.arm.check()
        setup.ways.find(self.arm.read().positions, pose)
        self.arm.configure()
        self.arm.torque_on()
        return ArmMotion(self.arm, self._clock, 1 / setup.rate, setup.largest_step, setup.ways, self.promise)

    def promise(self, seconds: float) -> None:
        """Tell the guard until when the next word comes [s from now].

        Raises:
            GuardLost: the guard is gone.
        """
        for guarded in (self, *self._beside):
            guarded._watchdog.promise(max(seconds, self._patience))

    def accompany(self, other: "GuardedArm") -> None:
        """Let one loop move two arms: while it looks after the first it does the same for the other, and vice versa."""
        self._beside, other._beside = (other,), (self,)

    def make_safe(self) -> None:
        """Hold the arm until it is slow, switch the torque off; what could not be done is in `doubt`."""
        with contextlib.suppress(GuardLost):  # which is no reason to leave the torque on
            self.promise(SETTING_UP)
        self.doubt = make_safe(self.arm)

    def leave(self) -> None:
        """Make the arm safe, give the port back and send the guard home."""
        self.make_safe()
        for other in self._beside:
            other._beside = ()
        self.arm.close()
        self._watchdog.release()

    def __enter__(self) -> "GuardedArm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()
