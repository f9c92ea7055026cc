"""Jobs side by side: each a plain function of one value, in processes of one thread."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from nas_data.errors import JobsFailed, NasError, WorkerLost

Job = TypeVar("Job")
Result = TypeVar("Result")
Pool = Callable[[int], Executor]
"""Makes what runs a number of jobs at a time."""


def run_jobs(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    after: Mapping[int, Collection[int]] | None = None,
    pool: Pool | None = None,
) -> Iterator[tuple[int, Result]]:
    """Run jobs and yield each result with its job's number, as it comes; where one fails, the others go on.

    Args:
        function: Importable by its name, as are its argument and result.
        jobs: Arguments; of those that can be begun, the first is.
        workers: Jobs at a time.
        after: Numbers of the jobs that a job builds on, all before it in `jobs`; it is left out where one fails.
        pool: What runs them; where None, processes of this machine, and with one worker this process.

    Raises:
        JobsFailed: several could not be done; says which, when all others are.
        WorkerLost: the system ended a worker, mostly for want of memory.
        Exception: the same of a single one, as it was raised there.
    """
    failed: dict[int, Exception] = {}
    done = 0
    try:
        for number, future in run_all(function, jobs, min(workers, len(jobs)), after or {}, pool):
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                raise error
            if isinstance(error, Exception):
                failed[number] = error  # told below, when all that can be done is done
            else:
                done += 1
                yield number, future.result()
    except BrokenProcessPool:
        raise WorkerLost(
            "A worker process was ended from outside, perhaps for want of memory; what was finished is kept: run the "
            "same command again, with --workers 1 if it happens again."
        ) from None
    if failed:
        raise combine_errors(failed, len(jobs), len(jobs) - done - len(failed))


def combine_errors(failed: dict[int, Exception], jobs: int, left_out: int = 0) -> Exception:
    """Return one error for all jobs that failed; what is no user's mistake stays what it is."""
    errors = [failed[number] for number in sorted(failed)]
    strange = [error for error in errors if not isinstance(error, NasError)]
    if strange or len(errors) == 1:
        return (strange or errors)[0]
    different = list(dict.fromkeys(str(error) for error in errors))
    others = f"{left_out} that build on them were left out; all others are done" if left_out else "all others are done"
    return JobsFailed(f"{len(errors)} of {jobs} jobs failed; {others}. {' '.join(different)}")


def run_all(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    after: Mapping[int, Collection[int]],
    pool: Pool | None,
) -> Iterator[tuple[int, Future[Result]]]:
    """Run jobs and yield the number of each as it ends, with what holds its result or its error."""
    done: set[int] = set()
    waiting = list(range(len(jobs)))

    def next_ready() -> int | None:
        ready = (number for number in waiting if done.issuperset(after.get(number, ())))
        return next(ready, None)

    if pool is None and workers <= 1:
        while (number := next_ready()) is not None:
            waiting.remove(number)
            future = done_here(function, jobs[number])
            yield number, future
            done.update([number] if future.exception() is None else [])
        return
    executor = (pool or processes)(workers)
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


def processes(workers: int) -> Executor:
    """Return a pool of processes of one thread each."""
    context = multiprocessing.get_context("spawn")  # a fork would inherit the locks of torch's and MuJoCo's threads
    return ProcessPoolExecutor(workers, mp_context=context, initializer=prepare_worker)


def done_here(function: Callable[[Job], Result], job: Job) -> Future[Result]:
    """Do a job in this process, and return what holds its result or its error."""
    future: Future[Result] = Future()
    try:
        future.set_result(function(job))
    except Exception as error:
        future.set_exception(error)
    return future


def prepare_worker() -> None:
    """Give a worker one thread, and let it die at once when the person interrupts or the program is killed."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ["OMP_NUM_THREADS"] = "1"
    threading.Thread(target=die_with_parent, daemon=True).start()


def die_with_parent() -> None:
    """End this process when the one that started it has ended, which an idle worker would not notice."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
