"""What a command says while it works longer than a person waits."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 2.0  # [s] of silence


class Counting:
    """A line of progress: rewritten on a terminal; elsewhere a new one at most every two seconds."""

    def __init__(self, what: str) -> None:
        """Say what is being done once something is counted."""
        self.what = what
        self._spoken = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Show how much of the whole is done."""
        if sys.stderr.isatty():
            print(f"\r{self.what} {done}/{total} ", end="\n" if done == total else "", file=sys.stderr, flush=True)
        elif time.monotonic() - self._spoken >= PATIENCE:
            self._spoken = time.monotonic()
            print(f"{self.what} {done}/{total}", file=sys.stderr, flush=True)


@contextmanager
def saying(what: str, pause: float = PATIENCE) -> Iterator[None]:
    """Say on stderr every two seconds, or after another pause [s], what is being done, and for how long."""
    done = threading.Event()

    def speak() -> None:
        seconds = 0.0
        while not done.wait(pause):
            seconds += pause
            print(f"{what}, {seconds:.0f} s", file=sys.stderr, flush=True)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        done.set()
        speaker.join()
