"""Capture of MuJoCo's warnings, which MuJoCo would otherwise print and write to MUJOCO_LOG.TXT."""

import functools
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco

from nas_data.log import logger

UNSTABLE = "unstable"  # word in the warnings after which MuJoCo resets a simulation


@dataclass
class WarningDispatcher:
    """Dispatches warnings to blocks of code: MuJoCo has one handler for all threads.

    Attributes:
        blocks: Thread and collected warnings of each active block.
        previous: Handler before the first block began.
        lock: Held while blocks begin and end.
    """

    blocks: list[tuple[int, list[str]]] = field(default_factory=list)
    previous: Callable[[str], None] | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def handle(self, warning: str) -> None:
        """Add a warning to the innermost block of the calling thread; to all blocks in a worker thread of MuJoCo."""
        blocks = list(self.blocks)
        own = [collected for thread, collected in blocks if thread == threading.get_ident()]
        for collected in own[-1:] or [collected for _, collected in blocks]:
            collected.append(warning)

    def enter(self, collected: list[str]) -> None:
        """Begin a block; the first one replaces MuJoCo's handler."""
        with self.lock:
            if not self.blocks:
                self.previous = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(self.handle)
            self.blocks.append((threading.get_ident(), collected))

    def leave(self, collected: list[str]) -> None:
        """End a block; the last one restores MuJoCo's handler."""
        with self.lock:
            self.blocks = [block for block in self.blocks if block[1] is not collected]
            if not self.blocks:
                mujoco.set_mju_user_warning(self.previous)


dispatcher = WarningDispatcher()


@contextmanager
def collect_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings inside the block."""
    collected: list[str] = []
    dispatcher.enter(collected)
    try:
        yield collected
    finally:
        dispatcher.leave(collected)


@contextmanager
def collect_instability() -> Iterator[list[str]]:
    """Collect warnings of unstable simulations inside the block; log the others."""
    unstable: list[str] = []
    with collect_warnings() as warnings:
        yield unstable
    unstable += [warning for warning in warnings if UNSTABLE in warning]
    log_warnings(warnings)


def log_warnings(warnings: Iterable[str]) -> None:
    """Log each different warning, except those of unstable simulations."""
    for warning in sorted({warning for warning in warnings if UNSTABLE not in warning}):
        _log_once(warning)


@functools.cache
def _log_once(warning: str) -> None:
    """Log a warning of the engine, once however often a command reads the model that it is about."""
    logger.warning(f"MuJoCo: {warning}")
