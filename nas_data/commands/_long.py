"""Options of long commands: where their jobs run, and a list of the jobs instead of a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from nas_data.runs.parallel import Workers
    from nas_data.runs.planned_jobs import PlannedJob


@dataclass(frozen=True, kw_only=True)
class LongCommand(Command):
    """A command that consists of many jobs."""

    workers: int = 1
    """Parallel jobs, or those of this process with --executor folder; several have one thread each."""
    executor: str = "local"
    """Where jobs run: local, on this machine; folder, on every machine that joins over a shared disk (see --join); or
    ray, on the cluster in RAY_ADDRESS (pip install 'nas_data[ray]'), whose machines share the working directory."""
    join: bool = False
    """Help a run that was begun with --executor folder: the same command in the same folder, any number of times. Each
    process takes jobs that no other has taken, and prints the results when all are done."""
    dry_run: bool = False
    """List the jobs with an estimate of their time, and run none."""

    def find_workers(self, out: Path) -> "Workers":
        """Return where the jobs of a run in a folder are done.

        Raises:
            UnknownName: there is no such executor; lists the executors.
            OptionError: there is no worker, or no run to join.
        """
        from nas_data.runs.executors import find_workers

        if not self.join:
            return find_workers(self.executor, self.workers)
        if self.executor not in {"local", "folder"}:
            raise OptionError(
                f"--join joins a run of --executor folder, not of {self.executor}; leave one of them out."
            )
        if not out.exists():
            raise OptionError(
                f"There is no run in {out} to join; begin it with --executor folder, and give --join elsewhere."
            )
        return find_workers("folder", self.workers)

    def list_jobs(self, jobs: "Sequence[PlannedJob]") -> CommandResult:
        """Return the jobs with an estimate of their time, for --dry-run."""
        from nas_data.runs.planned_jobs import describe_jobs, format_jobs

        return CommandResult(format_jobs(jobs, self.workers), describe_jobs(jobs, self.workers))
