"""A result that one program at a time may write: a lock that dies with its holder."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from nas_data.errors import BeingWritten


@contextmanager
def hold_write_lock(root: Path) -> Iterator[None]:
    """Write a result as long as this context is open, and nobody else; what is made for the lock is removed again.

    Args:
        root: What is written; it need not exist, nor the folders above it.

    Raises:
        BeingWritten: another program writes it.
    """
    made = [folder for folder in root.absolute().parents if not folder.exists()]
    lock = root.with_name(f".{root.name}.lock")
    descriptor = _locked(lock, root)
    try:
        os.truncate(descriptor, 0)
        os.write(descriptor, str(os.getpid()).encode())
        yield
    finally:
        lock.unlink(missing_ok=True)  # before it is released: nobody can have locked it meanwhile
        os.close(descriptor)
        with suppress(OSError):  # a folder in which there is a result stays
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
