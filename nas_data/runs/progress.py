"""Progress messages on stderr, at most one every few seconds, and durations as text."""

import io
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from nas_data.log import logger

if TYPE_CHECKING:
    from tqdm import tqdm

PAUSE = 2.0  # [s] between two lines
SILENCE = 10.0  # [s] without a message after which a running step is reported
SHOWN = 60  # characters of the last message that such a report repeats

Report = Callable[[str], None]

say: Report = logger.info
"""Log a message at once."""


def silence(_: str) -> None:
    """Report nothing."""


def format_duration(seconds: float) -> str:
    """Return a duration as text."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class RateLimited:
    """A report function that passes on at most one line every few seconds."""

    def __init__(self, report: Report = say, pause: float = PAUSE, first: float = 0.0) -> None:
        """Set the interval `pause` [s] and the delay of the first line [s]."""
        self.report = report
        self.pause = pause
        self.next = time.monotonic() + first

    def __call__(self, line: str) -> None:
        """Report a line, unless the last one is too recent."""
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + self.pause
            self.report(line)


class Lines(io.StringIO):
    """A file that shows each update of a tqdm bar as a line on stderr."""

    def write(self, text: str) -> int:
        """Show an update; empty ones of tqdm are ignored."""
        if state := text.strip():
            print(state, file=sys.stderr, flush=True)
        return len(text)


class Counting:
    """Progress count on stderr, from two seconds on: a bar on a terminal, elsewhere a line every two seconds."""

    def __init__(self, what: str) -> None:
        """Set the description."""
        self.what = what
        self.bar: tqdm | None = None

    def __call__(self, done: int, total: int, more: str = "") -> None:
        """Show the number of finished items and a suffix; the remaining time is estimated from the first call on."""
        if self.bar is None:
            from tqdm import tqdm

            elsewhere = {} if sys.stderr.isatty() else {"file": Lines(), "mininterval": PAUSE}
            self.bar = tqdm(desc=self.what, initial=done, total=total, delay=PAUSE, leave=False, **elsewhere)
        self.bar.set_postfix_str(more, refresh=False)
        self.bar.update(done - self.bar.n)
        if done == total:
            self.bar.close()


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
def report_elapsed(what: str, pause: float = PAUSE) -> Iterator[None]:
    """Show a description and the elapsed time on stderr at every pause [s]."""
    began = time.monotonic()
    with repeating(lambda: say(f"{what}, {time.monotonic() - began:.0f} s"), pause):
        yield


@contextmanager
def report_heartbeat(first: str, report: Report = say, silence: float = SILENCE) -> Iterator[Report]:
    """Yield a report function that also reports, after each silence [s], the time since its last line.

    Args:
        first: Description of the work until the first line.
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
