"""A result that one program at a time may write: a lock that dies with its holder."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from nas_data.errors import BeingWritten

TAKING = 0.1  # [s] for which a lock is tried: one that its holder has just removed is made anew


@contextmanager
def alone(root: Path) -> Iterator[None]:
    """Write a result as long as this context is open, and nobody else; what is made for the lock is removed again.

    Args:
        root: What is written; it need not exist, nor the folders above it.

    Raises:
        BeingWritten: another program writes it.
    """
    made = [folder for folder in root.absolute().parents if not folder.exists()]
    file = root.with_name(f".{root.name}.lock")
    try:
        lock = FileLock(file).acquire(timeout=TAKING)
    except Timeout:
        holder = file.read_text() if file.exists() else ""
        raise BeingWritten(
            f"{root} is being written by another program (process {holder or 'unknown'}); wait for its end, or choose "
            "another name."
        ) from None
    with lock:
        try:
            file.write_text(str(os.getpid()))
            yield
        finally:
            file.unlink(missing_ok=True)  # before it is released: nobody can have locked it meanwhile
            with suppress(OSError):  # a folder in which there is a result stays
                for folder in made:
                    folder.rmdir()
