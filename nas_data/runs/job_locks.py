"""Locks of the jobs of a run, so that no job is done by two processes at a time."""

import contextlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from nas_data.errors import OptionError, OutputExists

LOCKS = ".jobs"  # folder of the lock files in that of a run


def list_locks(folder: Path, names: Iterable[str]) -> list[Path]:
    """Return the lock files of the jobs of a run, by name."""
    return [folder / LOCKS / f"{name}.lock" for name in names]


class JobLocks:
    """Lock files of jobs. The system releases those of a process that ends, however it ends."""

    def __init__(self, files: Sequence[Path], shared: bool) -> None:
        """Take the lock file of each job, or none, and whether other processes may do some of the jobs."""
        self._files = files
        self._shared = shared
        self._held: dict[int, FileLock] = {}

    def take(self, number: int) -> bool:
        """Return whether this process may do a job; if so, no other process may until it is released.

        Raises:
            OutputExists: another process does it, and jobs are not shared.
            OptionError: jobs are shared, and the disk has no file locks.
        """
        if not self._files:
            return True
        file = self._files[number]
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(file)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            if self._shared:
                return False
            raise OutputExists(
                f"Another process works in {find_run(file)}; wait for it, choose another --out, or join it: "
                "--executor folder in both."
            ) from None
        except (NotImplementedError, OSError):
            if self._shared:
                raise OptionError(
                    f"--executor folder needs file locks, which the disk of {file} does not have."
                ) from None
            return True  # a lone process needs none
        self._held[number] = lock
        return True

    def release(self, number: int) -> None:
        """Release a job, if it is locked. The file remains only where others may wait for it."""
        if number in self._held:
            if not self._shared:
                self._files[number].unlink(missing_ok=True)
            self._held.pop(number).release()

    def release_all(self) -> None:
        """Release all jobs."""
        for number in list(self._held):
            self.release(number)
        folders = {file.parent for file in self._files} | {find_run(file) / LOCKS for file in self._files}
        for folder in sorted(folders, reverse=True):  # what is inside first
            with contextlib.suppress(OSError):  # a run that is shared keeps its files
                folder.rmdir()


def find_run(lock: Path) -> Path:
    """Return the folder of the run of a lock file."""
    return next(folder.parent for folder in lock.parents if folder.name == LOCKS)
