"""When a control loop does what: an absolute schedule, so that a late step does not shift those after it."""

import time
from typing import Protocol


class Clock(Protocol):
    """What tells the time and waits."""

    def now(self) -> float:
        """Return the time [s]; it never goes back."""

    def wait_until(self, when: float) -> None:
        """Return at a time [s], or at once where it is past."""


class MonotonicClock:
    """The system's monotonic clock."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def wait_until(self, when: float) -> None:
        """Sleep until a time [s]."""
        time.sleep(max(0.0, when - time.monotonic()))


class SteppedClock:
    """A clock that nobody waits for: it shows the time until which was waited last. For arms in lock-step."""

    def __init__(self) -> None:
        self._time = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        return self._time

    def wait_until(self, when: float) -> None:
        """Move the hands."""
        self._time = max(self._time, when)
