"""Work on several hypotheses side by side: the engine lets other threads run, and one thread a rollout wastes least."""

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Found = TypeVar("Found")

_here = threading.local()


def side_by_side(work: Callable[[Item], Found], items: Iterable[Item]) -> list[Found]:
    """Return what `work` makes of each item, in their order; items that are worked on here do not spread further."""
    waiting = list(items)
    if len(waiting) < 2 or shares_cores() or cores() < 2:
        return [work(item) for item in waiting]
    return list(executor().map(work, waiting))


def shares_cores() -> bool:
    """Whether this thread works on one of several items, so that its rollouts keep to one core."""
    return bool(getattr(_here, "shares", False))


@contextmanager
def on_one_core() -> Iterator[None]:
    """Keep this thread's work to one core, as if it were one of several items."""
    before = shares_cores()
    _here.shares = True
    try:
        yield
    finally:
        _here.shares = before


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


@cache
def executor() -> ThreadPoolExecutor:
    """Return the threads that are kept for all such work."""

    def begin() -> None:
        _here.shares = True

    return ThreadPoolExecutor(cores(), initializer=begin)
