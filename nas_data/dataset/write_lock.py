"""Write lock of a result; it is released when its process ends."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from nas_data.errors import BeingWritten

TAKING = 0.1  # [s] to retry a lock whose holder may be removing it


@contextmanager
def hold_write_lock(root: Path) -> Iterator[None]:
    """Hold the write lock of a result while the context is open; lock file and created folders are removed at the end.

    Args:
        root: Path of the result; it need not exist.

    Raises:
        BeingWritten: another program holds the lock.
    """
    made = [folder for folder in root.absolute().parents if not folder.exists()]
    file = root.with_name(f".{root.name}.lock")
    try:
        lock = FileLock(file).acquire(timeout=TAKING)
    except Timeout:
        holder = file.read_text() if file.exists() else ""
        raise BeingWritten(
            f"{root} is being written by another program (process {holder or 'unknown'}); wait until it ends, or "
            "choose another name."
        ) from None
    with lock:
        try:
            file.write_text(str(os.getpid()))
            yield
        finally:
            file.unlink(missing_ok=True)  # before the release, so that no other process holds it
            with suppress(OSError):  # a folder that is not empty stays
                for folder in made:
                    folder.rmdir()
