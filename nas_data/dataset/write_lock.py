"""Write lock of a result; it is released when its process ends."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from nas_data.errors import BeingWritten


@contextmanager
def hold_write_lock(root: Path) -> Iterator[None]:
    """Hold the write lock of a result while the context is open; lock file and created folders are removed at the end.

    Args:
        root: Path of the result; it need not exist.

    Raises:
        BeingWritten: another program holds the lock.
    """
    made = [folder for folder in root.absolute().parents if not folder.exists()]
    lock = root.with_name(f".{root.name}.lock")
    descriptor = _locked(lock, root)
    try:
        os.truncate(descriptor, 0)
        os.write(descriptor, str(os.getpid()).encode())
        yield
    finally:
        lock.unlink(missing_ok=True)  # before the release, so that no other process holds it
        os.close(descriptor)
        with suppress(OSError):  # a folder that is not empty stays
            for folder in made:
                folder.rmdir()


def _locked(lock: Path, root: Path) -> int:
    """Return the descriptor of a locked file that still has its name."""
    while True:
        lock.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, 20).decode() or "unknown"
            os.close(descriptor)
            raise BeingWritten(
                f"{root} is being written by another program (process {holder}); wait for its end, or choose another "
                "name."
            ) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), lock.stat()):
                return descriptor
        os.close(descriptor)  # its holder removed it just before
