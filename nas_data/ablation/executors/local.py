"""Trials on this machine: processes of one thread each; with one worker, this process."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool

from nas_data.ablation.executors.base import Job, Result
from nas_data.errors import WorkerLost
from nas_data.policies.parallel import run_jobs


def run(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Result]]:
    """Run jobs; see `Executor`.

    Raises:
        WorkerLost: the system ended a worker, mostly for want of memory.
    """
    try:
        yield from run_jobs(function, jobs, workers)
    except BrokenProcessPool:
        raise WorkerLost(
            "A worker process was ended from outside, perhaps for want of memory; what was finished is kept: "
            "run the same command again, with --workers 1 if it happens again."
        ) from None
