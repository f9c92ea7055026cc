"""The log of the package: progress and warnings, which programs show on stderr."""

import functools
import logging
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

logger = logging.getLogger("nas_data")


class StderrHandler(logging.Handler):
    """Shows each message on stderr, above the bars of tqdm."""

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message at once."""
        tqdm = sys.modules.get("tqdm")  # slow to load, and there is no bar before it is loaded
        (tqdm.tqdm.write if tqdm else print)(record.getMessage(), file=sys.stderr)


def show(level: int = logging.INFO) -> None:
    """Show messages from a level on stderr. Where nothing is configured, Python shows warnings alone."""
    logger.setLevel(level)
    logger.handlers = [StderrHandler()]
    logger.propagate = False  # LeRobot gives the root logger a handler, which would show each message again


def warn(warnings: Iterable[str]) -> None:
    """Log warnings."""
    for warning in warnings:
        logger.warning(f"nas: warning: {warning}")


@functools.cache
def warn_once(warning: str) -> None:
    """Log a warning, once however often its cause is met, and not in every worker process."""
    import multiprocessing  # slow to load

    if multiprocessing.parent_process() is None:
        warn([warning])


@contextmanager
def hide_warnings() -> Iterator[None]:
    """Show no warnings inside the block, where they would repeat what was said, of a copy that nobody knows."""
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
