"""Parallel jobs: calls of one function with one argument each, in single-threaded processes."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from nas_data.count_of import count_of
from nas_data.errors import JobsFailed, NasError, WorkerLost
from nas_data.log import logger, show

Job = TypeVar("Job")
Result = TypeVar("Result")
Pool = Callable[[int], Executor]
"""Creates an executor for a number of parallel jobs."""


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    after: Mapping[int, Collection[int]] | None = None,
    pool: Pool | None = None,
) -> Iterator[tuple[int, Result]]:
    """Run jobs, and yield each job's number and result as it finishes; the others continue if one fails.

    Args:
        function: Function; it, its argument and its result must be importable by name.
        jobs: Arguments; the first runnable jobs start first.
        workers: Number of parallel jobs.
        after: Numbers of the earlier jobs that each job depends on; it is skipped if one of them fails.
        pool: Creates the executor; None for local processes, or this process with one worker.

    Raises:
        JobsFailed: several jobs failed; raised after all others have finished.
        WorkerLost: the system killed a worker, usually for lack of memory.
        Exception: the error of a single failed job.
    """
    failed: dict[int, Exception] = {}
    done = 0
    try:
        for number, future in run_all(function, jobs, min(workers, len(jobs)), after or {}, pool):
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
    workers: int,
    after: Mapping[int, Collection[int]],
    pool: Pool | None,
) -> Iterator[tuple[int, Future[Result]]]:
    """Run jobs, and yield the number and future of each as it finishes."""
    done: set[int] = set()
    waiting = list(range(len(jobs)))

    def next_ready() -> int | None:
        ready = (number for number in waiting if done.issuperset(after.get(number, ())))
        return next(ready, None)

    if pool is None and workers <= 1:
        while (number := next_ready()) is not None:
            waiting.remove(number)
            future = run_here(function, jobs[number])
            yield number, future
            done.update([number] if future.exception() is None else [])
        return
    executor = (pool or make_process_pool)(workers)
    running: dict[Future[Result], int] = {}
    try:
        while True:
            while len(running) < workers and (number := next_ready()) is not None:
                waiting.remove(number)
                running[executor.submit(function, jobs[number])] = number
            if not running:
                return
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                number = running.pop(future)
                done.update([number] if future.exception() is None else [])
                yield number, future
    finally:
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


def run_here(function: Callable[[Job], Result], job: Job) -> Future[Result]:
    """Run a job in this process, and return its future."""
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
