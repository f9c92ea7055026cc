"""Parallel jobs: calls of one function with one argument each, in single-threaded processes."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from nas_data.count_of import count_of
from nas_data.errors import JobsFailed, NasError, WorkerLost
from nas_data.log import logger, show
from nas_data.runs.job_locks import JobLocks

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


ONE_WORKER = Workers()


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: Workers = Workers(),  # immutable
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
        locks: Lock file of each job, so that no job is done by two processes at a time; none for jobs that store
            nothing.

    Raises:
        OutputExists: another process does one of the jobs, and the workers are not shared.
        JobsFailed: several jobs failed; raised after all others have finished.
        WorkerLost: the system killed a worker, usually for lack of memory.
        Exception: the error of a single failed job.
    """
    failed: dict[int, Exception] = {}
    done = 0
    try:
        for number, future in run_all(function, jobs, workers, after or {}, JobLocks(locks, workers.shared)):
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
    executor = (workers.pool or (make_process_pool if count > 1 else Here))(count)
    try:
        while True:
            taken_elsewhere = False
            for number in [number for number in waiting if done.issuperset(after.get(number, ()))]:
                if len(running) == count:
                    break
                if locks.take(number):
                    waiting.remove(number)
                    running[executor.submit(function, jobs[number])] = number
                else:
                    taken_elsewhere = True
            if not running and not taken_elsewhere:
                return
            if not running:
                time.sleep(PAUSE)
                continue
            ended, _ = wait(running, PAUSE if taken_elsewhere else None, FIRST_COMPLETED)
            for future in ended:
                number = running.pop(future)
                locks.release(number)
                done.update([number] if future.exception() is None else [])
                yield number, future
    finally:
        locks.release_all()
        executor.shutdown(wait=False, cancel_futures=True)


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS has no affinity of processes


def make_process_pool(workers: int) -> Executor:
    """Return a pool of single-threaded processes."""
    context = multiprocessing.get_context("spawn")  # a fork would inherit locks of torch's and MuJoCo's threads
    return ProcessPoolExecutor(workers, mp_context=context, initializer=prepare_worker, initargs=(logger.level,))


class Here(Executor):
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


def prepare_worker(level: int) -> None:
    """Limit a worker to one thread, show its log from a level, and end it at an interrupt or when its parent dies."""
    show(level)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ["OMP_NUM_THREADS"] = "1"
    threading.Thread(target=die_with_parent, daemon=True).start()


def die_with_parent() -> None:
    """End this process when its parent has ended, which an idle worker would not notice."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
