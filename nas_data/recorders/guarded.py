"""Guarded access to an arm: it is checked first, watched while its torque is on, and always left without torque."""

import contextlib
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from nas_data.errors import GuardLost
from nas_data.hardware.arms.base import Driver, make_safe
from nas_data.recorders.arm_motion import ArmMotion
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.retry import TRIES, Retry
from nas_data.recorders.schedule import Clock
from nas_data.recorders.watchdog import Watchdog

SETTING_UP = 10.0  # [s] allowed for checking an arm, setting it up or making it safe
RECOVERY_SECONDS = 1.0  # [s] given to the bus to recover


@dataclass(frozen=True, kw_only=True)
class Setup:
    """An arm and its motion settings.

    Attributes:
        driver: Opens the arm.
        planner: Finds collision-free paths between poses.
        rate: Control rate [Hz].
        largest_step: Largest difference between successive commands [rad].
    """

    driver: Driver
    planner: PathPlanner
    rate: float = 100.0
    largest_step: float = 3.2


class GuardedArm:
    """An arm and its watchdog; a context manager that leaves the arm without torque.

    Attributes:
        arm: The arm.
        safety_warning: Safety step that failed on leaving; empty if none did.
    """

    def __init__(self, setup: Setup, clock: Clock, patience: float = 0.0) -> None:
        """Open the port and start the watchdog; nothing moves.

        Args:
            setup: The arm.
            clock: Clock of the control loop.
            patience: Longest normal time between two readings [s].

        Raises:
            ArmError: the port cannot be opened.
        """
        self.arm = setup.driver.open(clock.now)
        self.safety_warning = ""
        self._setup, self._clock, self._patience = setup, clock, patience
        self._watchdog = Watchdog(setup.driver)
        self._linked: tuple[GuardedArm, ...] = ()

    def take(self, pose: np.ndarray) -> ArmMotion:
        """Check the arm, configure it and switch its torque on.

        After a transient bus error the arm is made safe, and the procedure is repeated.

        Args:
            pose: First pose [rad], shape (n,). A collision-free path to it must exist.

        Raises:
            ArmError: the arm cannot be used.
        """
        return Retry(TRIES, self.recover).call(lambda: self._take(pose))

    def recover(self) -> None:
        """Make the arm safe, and give its bus time to recover."""
        self.make_safe()
        self._clock.wait_until(self._clock.now() + RECOVERY_SECONDS)

    def _take(self, pose: np.ndarray) -> ArmMotion:
        setup = self._setup
        self.extend_deadline(SETTING_UP)
        self.arm.check()
        setup.planner.find(self.arm.read().positions, pose)
        self.arm.configure()
        self.arm.torque_on()
        return ArmMotion(
            self.arm,
            self._clock,
            1 / setup.rate,
            setup.largest_step,
            setup.planner,
            self.extend_deadline,
            setup.driver.speed,
        )

    def extend_deadline(self, seconds: float) -> None:
        """Tell the watchdog that the next message comes within a time [s].

        Raises:
            GuardLost: the watchdog process has ended.
        """
        for guarded in (self, *self._linked):
            guarded._watchdog.extend_deadline(max(seconds, self._patience))

    def share_guard(self, other: "GuardedArm") -> None:
        """Let one control loop move two arms: extending the deadline of either extends that of both."""
        self._linked, other._linked = (other,), (self,)

    def make_safe(self) -> None:
        """Hold the arm until it is slow and switch its torque off; a failed step is in `safety_warning`."""
        with contextlib.suppress(GuardLost):  # the torque must go off all the same
            self.extend_deadline(SETTING_UP)
        self.safety_warning = make_safe(self.arm)

    def leave(self) -> None:
        """Make the arm safe, close the port and end the watchdog."""
        self.make_safe()
        for other in self._linked:
            other._linked = ()
        self.arm.close()
        self._watchdog.release()

    def __enter__(self) -> "GuardedArm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()
