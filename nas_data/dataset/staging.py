"""Atomic creation of a folder: it is written under a hidden name, flushed to the disk, then renamed."""

import errno
import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nas_data.errors import CannotWrite, NasError, OutputExists

MARK = ".partial-"


@contextmanager
def staging_folder(root: Path) -> Iterator[Path]:
    """Yield a hidden folder beside `root` to write into; it is removed afterwards unless it was published.

    The folder is locked while it is written, which distinguishes it from the remains of a killed process.
    """
    hidden = _make_hidden_path(root.parent, root)
    with _name_failures(root):
        root.parent.mkdir(parents=True, exist_ok=True)
        hidden.mkdir()
        try:
            with lock_folder(hidden):
                yield hidden
        finally:
            shutil.rmtree(hidden, ignore_errors=True)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Wait for the lock of a folder, and hold it while the context is open or until the process ends.

    `filelock` locks files only. A folder keeps its lock when it is renamed, and no lock file remains.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def check_creatable(root: Path) -> None:
    """Check that a folder can be created, before any work is done; nothing remains.

    Raises:
        OutputExists: the path exists.
        CannotWrite: a file has the name of a parent folder, permission is missing, or the disk is full.
    """
    with _name_failures(root):
        refuse_existing(root)
        above = next(folder for folder in root.absolute().parents if folder.exists())
        trial = _make_hidden_path(above, root)
        trial.mkdir()  # permissions alone do not show read-only disks and names that are too long
        trial.rmdir()


def _make_hidden_path(folder: Path, root: Path) -> Path:
    """Return a new hidden name for writing `root` in a folder."""
    return folder / f".{root.name}{MARK}{secrets.token_hex(4)}"


@contextmanager
def _name_failures(root: Path) -> Iterator[None]:
    """Turn errors of writing beside `root` into an error that names `root` and the reason."""
    try:
        yield
    except NasError:
        raise
    except OSError as error:
        where = Path(error.filename or root).absolute()
        if not (where.is_relative_to(root.absolute().parent) or root.absolute().is_relative_to(where.parent)):
            raise  # an error of reading another file
        reason = (error.strerror or str(error)).lower()
        raise CannotWrite(
            f"{root} cannot be written: {reason}; choose a folder that is writable and has free space."
        ) from error


def write_synced(path: Path, content: bytes | memoryview) -> None:
    """Write a file and flush it to the disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with path.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        error.filename = error.filename or str(path)  # the error of a full disk names no file
        raise


def publish(hidden: Path, root: Path) -> None:
    """Rename a staged folder to its final name.

    Raises:
        OutputExists: the path exists.
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
    """Raise OutputExists if the path exists."""
    if root.exists() or root.is_symlink():
        raise OutputExists(f"{root} exists already; choose another folder or remove it.")


def flush_folder(folder: Path) -> None:
    """Flush the entries of a folder to the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def find_leftovers(folder: Path, name: str = "*") -> list[Path]:
    """Return the hidden folders of killed writers in a folder, without folders of running ones."""
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
