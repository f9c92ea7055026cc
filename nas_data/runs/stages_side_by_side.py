"""Parallel stages: each runs in its own process as soon as its dependencies are finished."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic

from nas_data.runs.parallel import run_jobs
from nas_data.runs.progress import say
from nas_data.runs.stages import (
    INDENT,
    Plan,
    Stage,
    Work,
    begin,
    describe_kept,
    do,
    format_introduction,
    read_stage,
    run_stages,
)


@dataclass(frozen=True)
class Part(Generic[Plan]):
    """A stage to run in its own process.

    Attributes:
        stage: Its name.
        plan: See `Work`.
        folder: See `Work`.
        name: See `Work`.
    """

    stage: str
    plan: Plan
    folder: Path
    name: str


def run_side_by_side(
    stages: Sequence[Stage[Plan]], work: Work[Plan], workers: int, do_one: Callable[[Part[Plan]], None]
) -> None:
    """Run the unfinished stages, several at a time, the first runnable ones first.

    Args:
        stages: Stages in a valid sequential order.
        work: Plan and folder.
        workers: Number of processes.
        do_one: Function that runs a stage; importable by name.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
        JobsFailed: several stages failed; all others are finished except those that depend on them.
    """
    missing = begin(stages, work)
    if len(missing) < 2:
        run_stages(stages, work)
        return
    for stage in stages:
        if stage.name not in missing:
            work.report(f"{stage.title}: {describe_kept(read_stage(stage.name, work.folder))}")
    parts = [Part(stage.name, work.plan, work.folder, work.name) for stage in stages if stage.name in missing]
    for _ in run_jobs(do_one, parts, workers, find_prerequisites([stage for stage in stages if stage.name in missing])):
        pass


def find_prerequisites(stages: Sequence[Stage[Plan]]) -> Mapping[int, Sequence[int]]:
    """Return the indices of the earlier stages that each stage depends on, by index."""
    return {
        place: [
            before
            for before, other in enumerate(stages[:place])
            if stage.builds_on is None or other.name in stage.builds_on
        ]
        for place, stage in enumerate(stages)
    }


def do_part(stage: Stage[Plan], part: Part[Plan]) -> None:
    """Run a stage with one thread; print its title and result on stderr, each with its name."""
    work = Work(part.plan, part.folder, say, part.name, threads=1)
    work.report(format_introduction(stage.title, stage))
    done = do(stage, work)
    lines = [f"{stage.title}: took {done.seconds:.0f} s", *(f"{INDENT}{line}" for line in done.said)]
    work.report("\n".join(lines))
