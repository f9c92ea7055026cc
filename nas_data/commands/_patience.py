"""What a command says while it works longer than a person waits."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 2.0  # [s] of silence


@contextmanager
def saying(what: str) -> Iterator[None]:
    """Say on stderr every two seconds what is being done, and for how long."""
    done = threading.Event()

    def speak() -> None:
        seconds = 0.0
        while not done.wait(PATIENCE):
            seconds += PATIENCE
            print(f"{what}, {seconds:.0f} s", file=sys.stderr, flush=True)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        done.set()
        speaker.join()
