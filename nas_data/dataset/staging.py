"""A folder that appears whole or not at all: written under a hidden name, flushed, renamed once."""

import errno
import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nas_data.errors import OutputExists

MARK = ".partial-"


@contextmanager
def staged(root: Path) -> Iterator[Path]:
    """Yield a hidden folder beside `root` to write into; it is gone afterwards unless it was published.

    The folder is locked while it is written, so that a leftover of a killed process can be told from it.
    """
    root.parent.mkdir(parents=True, exist_ok=True)
    hidden = root.parent / f".{root.name}{MARK}{secrets.token_hex(4)}"
    hidden.mkdir()
    descriptor = os.open(hidden, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield hidden
    finally:
        os.close(descriptor)
        shutil.rmtree(hidden, ignore_errors=True)


def put(path: Path, content: bytes | memoryview) -> None:
    """Write a file and wait until it is on the disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def publish(hidden: Path, root: Path) -> None:
    """Give a staged folder its name.

    Raises:
        OutputExists: something of that name exists.
    """
    refuse_existing(root)
    for folder in [hidden, *(path for path in hidden.rglob("*") if path.is_dir())]:
        flush_folder(folder)
    try:
        hidden.rename(root)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR}:
            refuse_existing(root)
        raise
    flush_folder(root.parent)


def refuse_existing(root: Path) -> None:
    """Raise OutputExists where something of that name exists."""
    if root.exists() or root.is_symlink():
        raise OutputExists(f"{root} exists already; choose another folder or remove it.")


def flush_folder(folder: Path) -> None:
    """Wait until a folder's entries are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def leftovers(folder: Path, name: str = "*") -> list[Path]:
    """Return the hidden folders of killed writers in a folder; those still being written are not among them."""
    return [path for path in sorted(folder.glob(f".{name}{MARK}*")) if path.is_dir() and not _is_locked(path)]


def _is_locked(path: Path) -> bool:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
