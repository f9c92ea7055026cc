"""Warnings on stderr, each said once."""

import functools
import multiprocessing
import sys


@functools.cache
def say_once(warning: str) -> None:
    """Say a warning, once however often its cause is met, and not in every worker process."""
    if multiprocessing.parent_process() is None:
        print(f"nas: warning: {warning}", file=sys.stderr)
