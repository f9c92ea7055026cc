"""Resumable stages, one by one or side by side: each result is stored in a file that later runs read."""

import json
import os
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from nas_data.atomic_file import write_atomic
from nas_data.dataset.provenance import format_current_time
from nas_data.errors import NasError, OutputExists
from nas_data.runs.environment_info import find_commit
from nas_data.runs.job_locks import hold_run, list_locks
from nas_data.runs.parallel import Workers, run_jobs
from nas_data.runs.progress import Report, say
from nas_data.visible_files import list_visible_files

PLAN = "plan.json"
STAGES = "stages"
WIDTH, INDENT = 110, " " * 6  # line width and indentation of progress messages


class Described(Protocol):
    """A plan that describes what its results depend on."""

    def describe(self) -> dict[str, object]:
        """Return the description for JSON; different plans have different descriptions."""


Plan = TypeVar("Plan", bound=Described)


@dataclass(frozen=True)
class Work(Generic[Plan]):
    """A plan and its folder."""

    plan: Plan
    folder: Path  # folder of all results
    report: Report  # called with lines of progress
    name: str = "demo"  # name in messages
    threads: int | None = None  # simulation threads; None for all cores


@dataclass(frozen=True)
class StageResult:
    """Result of a stage."""

    lines: Sequence[str]  # lines of text, printed once
    data: Mapping[str, object]  # values for JSON
    summary: Sequence[str] = ()  # summary of one or two lines, printed at the end of every run


@dataclass(frozen=True)
class Stage(Generic[Plan]):
    """A stage."""

    name: str  # name of its result file
    title: str  # title of a few words
    does: str  # explanation of one or two sentences
    work: Callable[[Work[Plan]], StageResult]  # function that runs the stage
    made: Sequence[str] = ()  # output paths in the folder; the stage is repeated if one is missing
    # stages that it depends on; it is repeated after them. None for all earlier stages.
    builds_on: Sequence[str] | None = None
    # returns a hash of the code that determines its results; None if the code does not matter
    code: Callable[[Plan], str] | None = None


@dataclass(frozen=True)
class Done:
    """A finished stage, as its file holds it."""

    seconds: float  # wall time that it took [s]
    when: str  # when it ended, UTC, ISO 8601
    load: float  # One-minute load average of the machine at its end
    said: Sequence[str]  # lines of text
    data: Mapping[str, object]  # values for JSON
    summary: Sequence[str]
    cpu_seconds: float = 0.0  # processor time, child processes included [s]
    code: str = ""  # hash of the code that ran it
    commit: str | None = None  # commit of that code; None if unknown


def run_stages(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> dict[str, Done]:
    """Run the unfinished stages in order.

    Returns:
        Result of each stage.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
    """
    results: dict[str, Done] = {}
    check_plan(work)  # before a lock file is written
    with hold_run(work.folder):
        missing = begin(stages, work)
        for number, stage in enumerate(stages, start=1):
            head = f"[{number}/{len(stages)}] {stage.title}"
            if stage.name in missing:
                work.report(format_introduction(head, stage))
                try:
                    done = do(stage, work)
                except NasError:
                    release(work)
                    raise
                for line in (*done.said, f"took {done.seconds:.0f} s"):
                    work.report(f"{INDENT}{line}".rstrip())
            else:
                done = read_stage(stage.name, work.folder)
                work.report(f"{head}: {describe_kept(done)}")
            results[stage.name] = done
    return results


def begin(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> set[str]:
    """Claim the folder, remove outdated results, and return the names of the stages to run.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
    """
    missing = list_missing(stages, work)
    if not (work.folder / PLAN).is_file():
        write_atomic(work.folder / PLAN, (json.dumps(work.plan.describe(), indent=1) + "\n").encode())
    for name in (name for name, is_outdated in missing.items() if is_outdated):
        find_result(name, work.folder).unlink(missing_ok=True)
    return set(missing)


def release(work: Work[Plan]) -> None:
    """Remove the plan of a folder in which nothing was made, so that a corrected plan can take its place."""
    if [path for path in list_visible_files(work.folder, "**/*") if path.is_file()] == [work.folder / PLAN]:
        (work.folder / PLAN).unlink()


def list_missing(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> dict[str, bool]:
    """Return the names of the stages to run, and whether each has an outdated result; raises as `begin` does.

    A repeated stage makes the stages that depend on it outdated.
    """
    check_plan(work)
    check_code(stages, work)
    missing: dict[str, bool] = {}
    for stage in stages:
        behind = missing.keys() if stage.builds_on is None else missing.keys() & set(stage.builds_on)
        is_done = read_done(stage, work.folder) is not None
        if behind or not is_done:
            missing[stage.name] = is_done
    return missing


def format_introduction(head: str, stage: Stage[Plan]) -> str:
    """Return the message for the start of a stage."""
    return "\n".join([head, textwrap.fill(stage.does, WIDTH, initial_indent=INDENT, subsequent_indent=INDENT)])


def describe_kept(done: Done) -> str:
    """Return the message for a stage that an earlier run finished."""
    return f"done before, in {done.seconds:.0f} s; kept"


def check_plan(work: Work[Plan]) -> None:
    """Refuse a folder of something else.

    Raises:
        OutputExists: it holds something else, or the same work with another plan.
    """
    path = work.folder / PLAN
    if path.is_file():
        plan = json.loads(json.dumps(work.plan.describe()))
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            held = {}
        different = [key for key in plan if held.get(key) != plan[key]]
        if different:
            raise OutputExists(
                f"{work.folder} holds a {work.name} that differs in {', '.join(different)}; "
                "remove it or choose another --out."
            )
    elif work.folder.exists() and (not work.folder.is_dir() or list_visible_files(work.folder)):
        raise OutputExists(f"{work.folder} exists and is not a {work.name}; choose another --out.")


def check_code(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> None:
    """Refuse results of other code.

    Raises:
        OutputExists: other code ran one of the stages.
    """
    for stage in stages:
        done = read_done(stage, work.folder)
        if done is not None and stage.code is not None and done.code != stage.code(work.plan):
            raise OutputExists(
                f"'{stage.title}' in {work.folder} was made by another version of nas_data; remove "
                f"{find_result(stage.name, work.folder)} to repeat it and all that depends on it, "
                "or choose another --out."
            )


def do(stage: Stage[Plan], work: Work[Plan]) -> Done:
    """Run a stage and store its result."""
    began, cpu = time.monotonic(), measure_cpu_seconds()
    code = "" if stage.code is None else stage.code(work.plan)
    found = stage.work(work)
    done = Done(
        seconds=round(time.monotonic() - began, 2),
        cpu_seconds=round(measure_cpu_seconds() - cpu, 2),
        code=code,
        commit=find_commit(),
        when=format_current_time(),
        load=round(os.getloadavg()[0], 1),
        said=tuple(found.lines),
        data=found.data,
        summary=tuple(found.summary),
    )
    write_atomic(find_result(stage.name, work.folder), (json.dumps(asdict(done), indent=1) + "\n").encode())
    return done


def measure_cpu_seconds() -> float:
    """Return the processor time of this process and of its finished child processes [s]."""
    return sum(os.times()[:4])


def read_done(stage: Stage[Plan], folder: Path) -> Done | None:
    """Return the stored result of a stage; None if the stage must be run."""
    if not all((folder / path).exists() for path in stage.made):
        return None
    try:
        return read_stage(stage.name, folder)
    except (OSError, ValueError, TypeError):
        return None


def read_stage(name: str, folder: Path) -> Done:
    """Return the result of a finished stage; raises errors of reading its file."""
    return Done(**json.loads(find_result(name, folder).read_text(encoding="utf-8")))


def find_result(name: str, folder: Path) -> Path:
    """Return the file of a stage's result."""
    return folder / STAGES / f"{name}.json"


@dataclass(frozen=True)
class Part(Generic[Plan]):
    """A stage to run in its own process; the other fields are those of `Work`."""

    stage: str  # its name
    plan: Plan  # plan of the work
    folder: Path  # folder of all results
    name: str  # name in messages
    threads: int | None  # simulation threads; None for all cores


def run_side_by_side(
    stages: Sequence[Stage[Plan]], work: Work[Plan], workers: Workers, do_one: Callable[[Part[Plan]], None]
) -> None:
    """Run the unfinished stages, several at a time, the first runnable ones first.

    Args:
        stages: Stages in a valid sequential order.
        work: Plan and folder.
        workers: Where the stages run.
        do_one: Function that runs a stage; importable by name. It calls `do_part`.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
        JobsFailed: several stages failed; all others are finished except those that depend on them.
    """
    check_plan(work)  # before a lock file is written
    with hold_run(work.folder, workers.shared):
        missing = begin(stages, work)
        waiting = [stage for stage in stages if stage.name in missing]
        for stage in stages:
            if stage not in waiting:
                work.report(f"{stage.title}: {describe_kept(read_stage(stage.name, work.folder))}")
        parts = [
            Part(stage.name, work.plan, work.folder, work.name, 1 if workers.one_core else None) for stage in waiting
        ]
        locks = list_locks(work.folder, [stage.name for stage in waiting])
        for _ in run_jobs(do_one, parts, workers, find_prerequisites(waiting), locks):
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
    """Run a stage; print its title and result on stderr, each with its name.

    A stage that another process has done meanwhile is kept.

    Raises:
        OutputExists: that process has other code.
    """
    work = Work(part.plan, part.folder, say, part.name, part.threads)
    if read_done(stage, part.folder) is not None:
        check_code([stage], work)
        return
    work.report(format_introduction(stage.title, stage))
    done = do(stage, work)
    lines = [f"{stage.title}: took {done.seconds:.0f} s", *(f"{INDENT}{line}" for line in done.said)]
    work.report("\n".join(lines))
