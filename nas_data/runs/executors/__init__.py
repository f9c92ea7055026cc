"""Executors: the file `a_b.py` holds, as `EXECUTOR`, where `--executor a_b` runs the jobs of a long command.

Another cluster needs another file. Jobs are picklable, the function must be importable by name on every machine, and
the jobs' folders must have the same path there.
"""

from dataclasses import replace

from nas_data import registry
from nas_data.errors import OptionError
from nas_data.runs.parallel import Workers

FOLDER = "runs.executors"


def find_workers(executor: str, count: int) -> Workers:
    """Return the workers of an executor.

    Args:
        executor: Name of the executor.
        count: Number of parallel jobs.

    Raises:
        UnknownName: there is no such executor; lists the executors.
        OptionError: there is no worker.
    """
    if count < 1:
        raise OptionError(f"--workers is {count}; it must be 1 or more.")
    return replace(registry.find_value(FOLDER, executor, "executor", Workers), count=count)
