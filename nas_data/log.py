"""Logging of the package: progress and warnings, which programs show on stderr."""

import functools
import logging
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

logger = logging.getLogger("nas_data")


class StderrHandler(logging.Handler):
    """Writes messages to stderr, above tqdm's progress bars."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a message."""
        tqdm = sys.modules.get("tqdm")  # slow to import; before its import there is no progress bar
        (tqdm.tqdm.write if tqdm else print)(record.getMessage(), file=sys.stderr)


def show(level: int = logging.INFO) -> None:
    """Show messages of at least `level` on stderr. Without configuration, Python shows warnings only."""
    logger.setLevel(level)
    logger.handlers = [StderrHandler()]
    logger.propagate = False  # LeRobot adds a handler to the root logger, which would repeat each message


def warn(warnings: Iterable[str]) -> None:
    """Log warnings."""
    for warning in warnings:
        logger.warning(f"nas: warning: {warning}")


@functools.cache
def warn_once(warning: str) -> None:
    """Log a warning only once, and not in worker processes."""
    import multiprocessing  # slow to load

    if multiprocessing.parent_process() is None:
        warn([warning])


@contextmanager
def hide_warnings() -> Iterator[None]:
    """Show no warnings inside the block, which works with copies of what the user was already warned about."""
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
