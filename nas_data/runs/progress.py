"""Progress on stderr: lines, at most one every few seconds, and durations as text."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from nas_data.count_of import count_of

PAUSE = 2.0  # [s] between two lines
SILENCE = 10.0  # [s] after which a step that says nothing is said to go on
SHOWN = 60  # characters of the last line in the line that says that it goes on

Report = Callable[[str], None]


def say(line: str) -> None:
    """Show a line at once."""
    print(line, file=sys.stderr, flush=True)


def silence(_: str) -> None:
    """Report nothing."""


def format_duration(seconds: float) -> str:
    """Return a duration as text."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Calm:
    """A report that passes on at most one line every few seconds."""

    def __init__(self, report: Report = say, pause: float = PAUSE, first: float = 0.0) -> None:
        """Pass on to a report after at least a pause [s], and for the first time after another one."""
        self.report = report
        self.pause = pause
        self.next = time.monotonic() + first

    def __call__(self, line: str) -> None:
        """Report a line, unless the last one is too recent."""
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + self.pause
            self.report(line)


class Remaining:
    """Says on stderr how many episodes are done and how long the others will take.

    On a terminal it says so after each episode, elsewhere at most every two seconds and at the end.
    """

    def __init__(self, done: int, wanted: int, verb: str = "") -> None:
        """Begin with the episodes that are already done; the verb begins each line."""
        self.first, self.wanted, self.verb = done, wanted, verb
        self.began = self.spoken = time.monotonic()

    def __call__(self, done: int, more: str = "") -> None:
        """Report the number of finished episodes, and more at the end of the line."""
        now = time.monotonic()
        if sys.stderr.isatty() or now - self.spoken >= PAUSE or done == self.wanted:
            self.spoken = now
            left = (now - self.began) / (done - self.first) * (self.wanted - done)
            say(f"{self.verb}{done} of {count_of(self.wanted, 'episode')}, {left / 60:.0f} min left{more}")


class Counting:
    """A line of progress: rewritten on a terminal, otherwise a new line at most every two seconds."""

    def __init__(self, what: str) -> None:
        """Describe what is counted."""
        self.what = what
        self._spoken = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Show the number of finished items."""
        if sys.stderr.isatty():
            print(f"\r{self.what} {done}/{total} ", end="\n" if done == total else "", file=sys.stderr, flush=True)
        elif time.monotonic() - self._spoken >= PAUSE:
            self._spoken = time.monotonic()
            say(f"{self.what} {done}/{total}")


@contextmanager
def repeating(speak: Callable[[], None], pause: float) -> Iterator[None]:
    """Call a function in another thread after each pause [s] until the context ends."""
    done = threading.Event()

    def repeat() -> None:
        while not done.wait(pause):
            speak()

    speaker = threading.Thread(target=repeat, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        done.set()
        speaker.join()


@contextmanager
def saying(what: str, pause: float = PAUSE) -> Iterator[None]:
    """Show on stderr what is being done and for how long, every two seconds or after another pause [s]."""
    began = time.monotonic()
    with repeating(lambda: say(f"{what}, {time.monotonic() - began:.0f} s"), pause):
        yield


@contextmanager
def never_silent(first: str, report: Report = say, silence: float = SILENCE) -> Iterator[Report]:
    """Yield a report of lines that adds, after each silence [s], how long ago its last line was.

    Args:
        first: What is being done until the first line.
        report: Receives the lines.
        silence: Longest time without a line [s].
    """
    last, since = first, time.monotonic()
    spoken = since

    def tell(line: str) -> None:
        nonlocal last, since, spoken
        last, since = line, time.monotonic()
        spoken = since
        report(line)

    def go_on() -> None:
        nonlocal spoken
        now = time.monotonic()
        if now - spoken >= silence:
            spoken = now
            report(f"    {now - since:.0f} s since: {last.strip()[:SHOWN]}")

    with repeating(go_on, silence / 10):
        yield tell
