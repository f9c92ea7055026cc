"""Independent jobs side by side: each a plain function of one value, in processes of one thread."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from nas_data.errors import JobsFailed, NasError, WorkerLost

Job = TypeVar("Job")
Result = TypeVar("Result")


def run_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Result]]:
    """Run jobs and yield each result with its job's number, as it comes; where one fails, the others go on.

    Args:
        function: Importable by its name, as are its argument and result.
        jobs: Arguments.
        workers: Processes; with one, all is done in this one.

    Raises:
        JobsFailed: several could not be done; says which, when all others are.
        WorkerLost: the system ended a worker, mostly for want of memory.
        Exception: the same of a single one, as it was raised there.
    """
    failed: dict[int, Exception] = {}
    for number, outcome in run_all(function, jobs, min(workers, len(jobs))):
        try:
            result = outcome()
        except BrokenProcessPool:
            raise WorkerLost(
                "A worker process was ended from outside, perhaps for want of memory; what was finished is kept: "
                "run the same command again, with --workers 1 if it happens again."
            ) from None
        except Exception as error:  # told below, when all that can be done is done
            failed[number] = error
        else:
            yield number, result
    if failed:
        raise told(failed, len(jobs))


def told(failed: dict[int, Exception], jobs: int) -> Exception:
    """Return one error for all jobs that failed; what is no user's mistake stays what it is."""
    errors = [failed[number] for number in sorted(failed)]
    strange = [error for error in errors if not isinstance(error, NasError)]
    if strange or len(errors) == 1:
        return (strange or errors)[0]
    different = list(dict.fromkeys(str(error) for error in errors))
    return JobsFailed(f"{len(errors)} of {jobs} jobs failed; all others are done. {' '.join(different)}")


def run_all(
    function: Callable[[Job], Result], jobs: Sequence[Job], workers: int
) -> Iterator[tuple[int, Callable[[], Result]]]:
    """Run jobs and yield for each, as it ends, its number and what returns its result or raises its error."""
    if workers <= 1:
        for number, job in enumerate(jobs):
            yield number, partial(function, job)
        return
    context = multiprocessing.get_context("spawn")  # a fork would inherit the locks of torch's and MuJoCo's threads
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=prepare_worker)
    try:
        numbers = {executor.submit(function, job): number for number, job in enumerate(jobs)}
        for future in as_completed(numbers):
            yield numbers[future], future.result
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


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
