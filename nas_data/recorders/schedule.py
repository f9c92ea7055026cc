"""Clocks of control loops. Loops wait for absolute times, so that a late step does not shift later ones."""

import time
from typing import Protocol


class Clock(Protocol):
    """Interface of a clock that tells the time and waits."""

    def now(self) -> float:
        """Return the monotonic time [s]."""

    def wait_until(self, when: float) -> None:
        """Wait until a time [s]; return at once if it is past."""


class MonotonicClock:
    """The system's monotonic clock."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def wait_until(self, when: float) -> None:
        """Sleep until a time [s]."""
        time.sleep(max(0.0, when - time.monotonic()))


class SteppedClock:
    """A clock for arms in lock-step: waiting takes no time and sets the clock."""

    def __init__(self) -> None:
        self._time = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        return self._time

    def wait_until(self, when: float) -> None:
        """Set the clock to a time [s], unless it is past."""
        self._time = max(self._time, when)
