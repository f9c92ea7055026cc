"""Interface of executors: functions that run jobs and yield each result as it arrives."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Protocol, TypeVar

from nas_data import registry

FOLDER = "studies.ablation.executors"

Job = TypeVar("Job")
Result = TypeVar("Result")


class Executor(Protocol):
    """An executor; the file `ablation/executors/a_b.py` holds the executor `a_b` as function `run`.

    Another cluster needs one more file. Jobs are picklable, the function must be importable by name on every machine,
    and the jobs' folders must have the same path there.
    """

    def __call__(
        self,
        function: Callable[[Job], Result],
        jobs: Sequence[Job],
        workers: int,
        after: Mapping[int, Collection[int]] | None = None,
    ) -> Iterator[tuple[int, Result]]:
        """Run jobs and yield each result with its job's number, as it comes.

        Args:
            function: Importable by its name, as are its argument and result.
            jobs: Arguments.
            workers: Jobs that run at a time.
            after: Numbers of the jobs that a job waits for, all before it.
        """
        ...


def find_executor(name: str) -> Executor:
    """Return an executor by its name.

    Raises:
        UnknownName: there is no such executor; lists those there are.
    """
    executor: Executor = registry.import_plugin(FOLDER, name, "executor").run
    return executor
