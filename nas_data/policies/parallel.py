"""Independent jobs side by side: each a plain function of one value, in processes of one thread."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def run_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Result]]:
    """Run jobs and yield each result with its job's number, as it comes.

    Args:
        function: Importable by its name, as are its argument and result.
        jobs: Arguments.
        workers: Processes; with one, all is done in this one.
    """
    workers = min(workers, len(jobs))
    if workers <= 1:
        for number, job in enumerate(jobs):
            yield number, function(job)
        return
    context = multiprocessing.get_context("spawn")  # a fork would inherit the locks of torch's and MuJoCo's threads
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=prepare_worker)
    try:
        numbers = {executor.submit(function, job): number for number, job in enumerate(jobs)}
        for future in as_completed(numbers):
            yield numbers[future], future.result()
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
