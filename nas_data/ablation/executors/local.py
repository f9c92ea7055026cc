"""Trials on this machine: processes of one thread each; with one worker, this process."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

from nas_data.ablation.executors.base import Job, Result
from nas_data.parallel import run_jobs


def run(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    after: Mapping[int, Collection[int]] | None = None,
) -> Iterator[tuple[int, Result]]:
    """Run jobs; see `Executor`.

    Raises:
        WorkerLost: the system ended a worker, mostly for want of memory.
    """
    return run_jobs(function, jobs, workers, after)
