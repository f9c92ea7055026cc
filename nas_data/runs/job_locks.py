"""Locks of the jobs of a run, so that no job is done by two processes at a time."""

import contextlib
import errno
import os
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from nas_data.errors import OptionError, OutputExists

LOCK_FOLDER = ".jobs"  # folder of the lock files in that of a run
RUN_LOCK = "run.lock"  # lock file of a run that is not shared
WITHOUT_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}


def list_locks(folder: Path, names: Iterable[str]) -> list[Path]:
    """Return the lock files of the jobs of a run, by name."""
    return [folder / LOCK_FOLDER / f"{name}.lock" for name in names]


@contextmanager
def hold_run(folder: Path, shared: bool = False) -> Iterator[None]:
    """Keep other processes out of a run's folder while this process works there alone; may be nested.

    A shared run only looks whether a process works there alone.

    Raises:
        OutputExists: another process works there alone.
        OptionError: the run is shared, and the disk has no file locks.
    """
    file = folder / LOCK_FOLDER / RUN_LOCK
    lock = FileLock(file, mode=0o666, is_singleton=True, fallback_to_soft=False)
    if not acquire(lock, required=shared):
        raise OutputExists(describe_other(folder, file, "wait for it, as it was begun without --executor folder"))
    if shared:
        lock.release()
    try:
        yield
    finally:
        if not shared:
            if lock.lock_counter <= 1:
                file.unlink(missing_ok=True)
            lock.release()
            with contextlib.suppress(OSError):  # jobs of a shared run have files there, too
                file.parent.rmdir()


def check_free(files: Sequence[Path]) -> None:
    """Refuse to work alone in a run whose jobs other processes do.

    Raises:
        OutputExists: another process does one of the jobs.
    """
    for file in files:
        if file.exists():
            lock = FileLock(file, fallback_to_soft=False)
            if not acquire(lock, required=False):
                raise OutputExists(describe_other(find_run(file), file, "join it with --join"))
            lock.release()


def describe_other(folder: Path, file: Path, advice: str) -> str:
    """Return a sentence on another process that works in a folder and holds a lock file."""
    return f"Another process works in {folder}{describe_holder(file)}; {advice}, or choose another --out."


def acquire(lock: FileLock, required: bool) -> bool:
    """Return whether a lock was free and is now held by this process.

    Args:
        lock: The lock.
        required: Whether the disk must have file locks; otherwise a lock counts as free on a disk that has none.

    Raises:
        OptionError: the disk has no file locks.
    """
    file = Path(lock.lock_file)
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return False
    except (NotImplementedError, OSError) as error:
        if isinstance(error, OSError) and error.errno not in WITHOUT_LOCKS:
            raise
        if required:
            raise OptionError(f"--executor folder needs file locks, which the disk of {file} does not have.") from None
        return True
    with contextlib.suppress(OSError):
        file.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
    return True


def describe_holder(file: Path) -> str:
    """Return the process that wrote a lock file, in brackets; empty if it is not known."""
    with contextlib.suppress(OSError):
        if holder := file.read_text(encoding="utf-8"):
            return f" ({holder})"
    return ""


class JobLocks:
    """Lock files of the jobs of a shared run. The system releases those of a process that ends, however it ends."""

    def __init__(self, files: Sequence[Path]) -> None:
        """Take the lock file of each job, or none."""
        self._files = files
        self._held: dict[int, FileLock] = {}

    def take(self, number: int) -> bool:
        """Return whether this process may do a job; if so, no other process may until it is released.

        Raises:
            OptionError: the disk has no file locks.
        """
        if not self._files:
            return True
        lock = FileLock(self._files[number], mode=0o666, fallback_to_soft=False)
        if not acquire(lock, required=True):
            return False
        self._held[number] = lock
        return True

    def release(self, number: int) -> None:
        """Release a job, if it is locked."""
        if number in self._held:
            self._held.pop(number).release()

    def release_all(self) -> None:
        """Release all jobs."""
        for number in list(self._held):
            self.release(number)

    def describe(self, numbers: Iterable[int]) -> str:
        """Return the names of jobs, with the processes that do them."""
        files = [self._files[number] for number in numbers]
        return ", ".join(f"{name_job(file)}{describe_holder(file)}" for file in files)


def name_job(file: Path) -> str:
    """Return the name of the job of a lock file."""
    return str(file.relative_to(find_run(file) / LOCK_FOLDER).with_suffix(""))


def find_run(file: Path) -> Path:
    """Return the folder of the run of a lock file."""
    return next(folder.parent for folder in file.parents if folder.name == LOCK_FOLDER)
