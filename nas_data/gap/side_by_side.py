"""Parallel work on several hypotheses in threads, with one rollout thread each."""

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from nas_data.runs.parallel import count_cores

Item = TypeVar("Item")
Found = TypeVar("Found")

_here = threading.local()


def map_in_parallel(work: Callable[[Item], Found], items: Iterable[Item]) -> list[Found]:
    """Return `work` of each item in order, computed in parallel; nested calls stay on their thread."""
    waiting = list(items)
    if len(waiting) < 2 or is_sharing_cores() or count_cores() < 2:
        return [work(item) for item in waiting]
    return list(get_executor().map(work, waiting))


def is_sharing_cores() -> bool:
    """Whether this thread works on one of several items, so that its rollouts use one core."""
    return bool(getattr(_here, "shares", False))


@contextmanager
def on_one_core() -> Iterator[None]:
    """Restrict this thread's work to one core."""
    before = is_sharing_cores()
    _here.shares = True
    try:
        yield
    finally:
        _here.shares = before


@cache
def get_executor() -> ThreadPoolExecutor:
    """Return the thread pool, which is created once."""

    def begin() -> None:
        _here.shares = True

    return ThreadPoolExecutor(count_cores(), initializer=begin)
