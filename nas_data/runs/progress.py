"""Progress messages on stderr, at most one every few seconds, and durations as text."""

import io
import logging
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
SHOWN = 60  # characters of the step's name that such a report shows

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
        STEP.begin(f"{self.what}: {done} of {total}")
        STEP.shown = STEP.began
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


class Step(logging.Handler):
    """The present step of the program, which is named by each message and by `begin`.

    Attributes:
        what: Name of the step.
        began: Its start [s].
        shown: Time of the last message or count on stderr [s].
    """

    def __init__(self) -> None:
        """Begin without a name."""
        super().__init__()
        self.begin("")
        self.shown = self.began

    def begin(self, what: str) -> None:
        """Begin a step; of several lines the first names it."""
        self.what, self.began = what.strip().partition("\n")[0][:SHOWN], time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Begin the step that a message names."""
        self.shown = time.monotonic()
        if record.levelno == logging.INFO and not hasattr(record, "elapsed"):  # no warning, none of `report_if_silent`
            self.begin(record.getMessage())

    def report_if_silent(self, silence: float) -> None:
        """Log the present step if nothing was shown for `silence` [s]."""
        now = time.monotonic()
        if now - self.shown >= silence:
            elapsed = now - self.began
            since = f"{elapsed:.0f} s since: " if elapsed >= silence else ""  # a step of several that has just begun
            logger.info(f"    {since}{self.what}", extra={"elapsed": elapsed})


STEP = Step()


def begin(what: str) -> None:
    """Name the next step, which is shown only if it takes long."""
    STEP.begin(what)


@contextmanager
def report_silence(first: str, silence: float = SILENCE) -> Iterator[None]:
    """Log the present step and its duration after each `silence` [s] without a message.

    Args:
        first: Name of the first step.
        silence: Longest time without a message [s].
    """
    STEP.begin(first)
    STEP.shown = STEP.began
    logger.addHandler(STEP)
    try:
        with repeating(lambda: STEP.report_if_silent(silence), silence / 10):
            yield
    finally:
        logger.removeHandler(STEP)
