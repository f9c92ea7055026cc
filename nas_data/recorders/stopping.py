"""Requests to end a recording: whoever makes them, the arm is made safe first."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stoppable() -> Iterator[None]:
    """Let every request to end (of the system, of a terminal that is closed) be what Ctrl-C is: the arm is made safe.

    Ctrl-C itself is among them, for a shell hands it down as ignored to what it runs in the background.
    """

    def stop(number: int, _: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
