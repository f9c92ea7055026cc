"""Parallel jobs: calls of one function with one argument each, in single-threaded processes."""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

from nas_data.count_of import count_of
from nas_data.errors import JobsFailed, NasError, WorkerLost
from nas_data.log import logger, show
from nas_data.runs.job_locks import JobLocks, check_free, find_run, hold_run

Job = TypeVar("Job")
Result = TypeVar("Result")
Pool = Callable[[int], Executor]
"""Creates an executor for a number of parallel jobs."""

PAUSE = 1.0  # [s] after which jobs that another process has taken are looked at again


@dataclass(frozen=True)
class Workers:
    """Where the jobs of a long command run.

    Attributes:
        count: Number of parallel jobs of this process.
        pool: Creates their executor; None for local processes, or this process with one worker.
        shared: Whether other processes may take jobs of the same run; each job is done by one of them.
    """

    count: int = 1
    pool: Pool | None = None
    shared: bool = False

    @property
    def one_core(self) -> bool:
        """Whether a job has one core, because other jobs run beside it."""
        return self.count > 1 or self.pool is not None or self.shared


ONE_WORKER = Workers()


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: Workers = ONE_WORKER,
    after: Mapping[int, Collection[int]] | None = None,
    locks: Sequence[Path] = (),
) -> Iterator[tuple[int, Result]]:
    """Run jobs, and yield each job's number and result as it finishes; the others continue if one fails.

    Args:
        function: Function; it, its argument and its result must be importable by name. For shared workers, it returns
            the stored result of a job that another process has done.
        jobs: Arguments; the first runnable jobs start first.
        workers: Where they run.
        after: Numbers of the earlier jobs that each job depends on; it is skipped if one of them fails.
        locks: Lock file of each job, all in one run, so that no job is done by two processes at a time; none for jobs
            that store nothing.

    Raises:
        OutputExists: another process works in the run, and it or this one is not shared.
        JobsFailed: several jobs failed; raised after all others have finished.
        WorkerLost: the system killed a worker, usually for lack of memory.
        Exception: the error of a single failed job.
    """
    failed: dict[int, Exception] = {}
    done = 0
    run = hold_run(find_run(locks[0]), workers.shared) if locks else nullcontext()
    try:
        with run:
            if not workers.shared:
                check_free(locks)
            for number, future in run_all(
                function, jobs, workers, after or {}, JobLocks(locks if workers.shared else ())
            ):
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    raise error
                if isinstance(error, Exception):
                    failed[number] = error  # raised below, after all other jobs
                else:
                    done += 1
                    yield number, future.result()
    except BrokenProcessPool:
        raise WorkerLost(
            "A worker process was killed, perhaps because memory ran out; finished work is kept: run the "
            "same command again, with --workers 1 if it happens again."
        ) from None
    if failed:
        raise combine_errors(failed, len(jobs), len(jobs) - done - len(failed))


def combine_errors(failed: dict[int, Exception], jobs: int, left_out: int = 0) -> Exception:
    """Combine the errors of failed jobs; unexpected errors are returned unchanged."""
    errors = [failed[number] for number in sorted(failed)]
    strange = [error for error in errors if not isinstance(error, NasError)]
    if strange or len(errors) == 1:
        return (strange or errors)[0]
    different = list(dict.fromkeys(str(error) for error in errors))
    others = f"{left_out} that depend on them were skipped; all others are done" if left_out else "all others are done"
    return JobsFailed(f"{len(errors)} of {count_of(jobs, 'job')} failed; {others}. {' '.join(different)}")


def run_all(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: Workers,
    after: Mapping[int, Collection[int]],
    locks: JobLocks,
) -> Iterator[tuple[int, Future[Result]]]:
    """Run jobs, and yield the number and future of each as it finishes."""
    count = max(1, min(workers.count, len(jobs)))
    done: set[int] = set()
    waiting = list(range(len(jobs)))
    running: dict[Future[Result], int] = {}
    executor = (workers.pool or (ProcessPool if count > 1 else ThisProcess))(count)
    said: list[int] = []
    try:
        while True:
            elsewhere = []  # jobs that other processes do
            for number in [number for number in waiting if done.issuperset(after.get(number, ()))]:
                if len(running) == count:
                    break
                if locks.take(number):
                    waiting.remove(number)
                    running[executor.submit(function, jobs[number])] = number
                else:
                    elsewhere.append(number)
            if not running:
                if not elsewhere:
                    return
                if elsewhere != said:
                    logger.info(f"waiting for {count_of(len(elsewhere), 'job')}: {locks.describe(elsewhere)}")
                    said = elsewhere
                time.sleep(PAUSE)
                continue
            ended, _ = wait(running, PAUSE if elsewhere else None, FIRST_COMPLETED)
            for future in ended:
                number = running.pop(future)
                locks.release(number)
                done.update([number] if future.exception() is None else [])
                yield number, future
    finally:
        executor.shutdown(cancel_futures=bool(running))
        locks.release_all()


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity of processes


class ProcessPool(ProcessPoolExecutor):
    """A pool of single-threaded processes, whose running jobs end when they are cancelled."""

    def __init__(self, count: int) -> None:
        """Start the pool."""
        context = multiprocessing.get_context("spawn")  # a fork would inherit locks of torch's and MuJoCo's threads
        end, self._open = context.Pipe(duplex=False)
        arguments = (logger.level, end)
        super().__init__(count, mp_context=context, initializer=prepare_worker, initargs=arguments)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: at once if jobs are cancelled, else after their jobs."""
        if cancel_futures:
            self._open.close()
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        self._open.close()


class ThisProcess(Executor):
    """This process behind Python's interface of executors: a job is done when it is submitted."""

    def __init__(self, count: int) -> None:
        """Take the number of parallel jobs, which is one."""

    def submit(self, function: Callable[[Job], Result], job: Job) -> Future[Result]:  # type: ignore[override]
        """Run a job, and return its future."""
        future: Future[Result] = Future()
        try:
            future.set_result(function(job))
        except Exception as error:
            future.set_exception(error)
        return future


def prepare_worker(level: int, end: Connection) -> None:
    """Limit a worker to one thread, show its log from a level, and end it at an interrupt or with its pool.

    Args:
        level: Level of the log.
        end: Connection whose other end is closed when the pool ends, or by the system when its process does.
    """
    show(level)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ["OMP_NUM_THREADS"] = "1"
    threading.Thread(target=die_with_pool, args=(end,), daemon=True).start()


def die_with_pool(end: Connection) -> None:
    """End this process when its pool has ended, which an idle worker would not notice."""
    with contextlib.suppress(OSError):
        end.poll(None)
    os._exit(1)
