"""Jobs on a Ray cluster, one task of one core each; RAY_ADDRESS names the cluster, else one is started here."""

import logging
import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import TypeVar, cast

from nas_data.errors import MissingPackage, WorkerLost
from nas_data.runs.parallel import Workers

Job = TypeVar("Job")
Result = TypeVar("Result")


class RayPool(Executor):
    """Ray behind Python's interface of executors.

    Every machine of the cluster needs this package, and the working directory with datasets and results at the same
    path (a shared file system).
    """

    def __init__(self, workers: int) -> None:
        """Connect to the cluster, or start one of `workers` cores on this machine.

        Raises:
            MissingPackage: Ray is not installed.
        """
        try:
            import ray
        except ImportError:
            raise MissingPackage("The executor ray needs Ray: pip install 'nas_data[ray]'") from None
        self._began = not ray.is_initialized()
        if self._began:
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage reports to Ray's makers
            cores = None if os.environ.get("RAY_ADDRESS") else workers  # an existing cluster knows its number of cores
            ray.init(num_cpus=cores, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        self._ray = ray

    def submit(self, function: Callable[[Job], Result], job: Job) -> "Future[Result]":  # type: ignore[override]
        """Start a job, and return the future of its result or error."""
        future: Future[Result] = Future()
        task = self._ray.remote(num_cpus=1)(run_in)  # type: ignore[var-annotated]  # Ray's types lose the function's
        ended = cast("Future[Result]", task.remote(function, job, str(Path.cwd())).future())
        ended.add_done_callback(lambda done: settle(future, done))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect; a cluster that was started here ends, together with running jobs."""
        if self._began:
            self._ray.shutdown()


EXECUTOR = Workers(pool=RayPool)


def run_in(function: Callable[[Job], Result], job: Job, folder: str) -> Result:
    """Run a job in the folder where the command was started.

    Raises:
        WorkerLost: this machine has no such folder.
    """
    try:
        os.chdir(folder)
    except OSError:
        raise WorkerLost(
            f"A machine of the cluster has no folder {folder}; start the command in one that all machines share."
        ) from None
    return function(job)


def settle(future: "Future[Result]", ended: "Future[Result]") -> None:
    """Copy the outcome of a task: its result, its error, or that it was lost."""
    from ray.exceptions import RayTaskError

    error = ended.exception()
    if error is None:
        future.set_result(ended.result())
    elif isinstance(error, RayTaskError):
        future.set_exception(error.cause)
    else:
        reason = str(error).strip().splitlines()[0].rstrip(".")
        future.set_exception(WorkerLost(f"Ray lost a job ({reason}); finished work is kept: run it again."))
