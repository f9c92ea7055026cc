"""Stages that are done once: what each found is kept in a file, and a later run reads it instead of working again."""

import json
import os
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from nas_data.dataset.provenance import now
from nas_data.errors import OutputExists
from nas_data.runs.environment_info import commit
from nas_data.whole_file import write_whole

PLAN = "plan.json"
STAGES = "stages"
WIDTH, INDENT = 110, " " * 6  # of what people read while it runs

Report = Callable[[str], None]


class Described(Protocol):
    """A plan that can say what its results depend on."""

    def describe(self) -> dict[str, object]:
        """Return it for JSON: other plans give other descriptions."""


Plan = TypeVar("Plan", bound=Described)


@dataclass(frozen=True)
class Work(Generic[Plan]):
    """What stages work on: a plan in a folder.

    Attributes:
        plan: What is to be done, and how large.
        folder: Where everything lies.
        report: Told of progress, in lines for people.
        name: What people call it.
        threads: Threads that simulate; all cores where None.
    """

    plan: Plan
    folder: Path
    report: Report
    name: str = "demo"
    threads: int | None = None


@dataclass(frozen=True)
class StageResult:
    """What a stage found.

    Attributes:
        said: Lines for people, told once.
        data: For machines.
        summary: What it comes to, in a line or two, told at the end of every run.
    """

    said: Sequence[str]
    data: Mapping[str, object]
    summary: Sequence[str] = ()


@dataclass(frozen=True)
class Stage(Generic[Plan]):
    """A part of the work.

    Attributes:
        name: File in which what it found is kept.
        title: What it is, in a few words.
        does: What it does, in a sentence or two for newcomers.
        work: Does it.
        made: Paths in the folder without which it must be done again.
        builds_on: Stages whose results it uses, and after which it must be done again; all before it where None.
        code: Returns a hash of the code that decides its results; None where any code will do.
    """

    name: str
    title: str
    does: str
    work: Callable[[Work[Plan]], StageResult]
    made: Sequence[str] = ()
    builds_on: Sequence[str] | None = None
    code: Callable[[Plan], str] | None = None


@dataclass(frozen=True)
class Done:
    """A finished stage, as its file holds it.

    Attributes:
        seconds: Wall time that it took [s].
        when: When it ended, UTC, ISO 8601.
        load: Processes that wanted to run on the machine at its end, mean of a minute.
        said: Lines for people.
        data: For machines.
        summary: What it comes to.
        cpu_seconds: Processor time that it took, processes of its own included [s].
        code: Hash of the code that did it.
        commit: Commit of that code, where it is known.
    """

    seconds: float
    when: str
    load: float
    said: Sequence[str]
    data: Mapping[str, object]
    summary: Sequence[str]
    cpu_seconds: float = 0.0
    code: str = ""
    commit: str | None = None


def run_stages(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> dict[str, Done]:
    """Do each stage that is not done yet, in order.

    Returns:
        What each found.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
    """
    missing = begin(stages, work)
    results: dict[str, Done] = {}
    for number, stage in enumerate(stages, start=1):
        head = f"[{number}/{len(stages)}] {stage.title}"
        if stage.name in missing:
            work.report(introduction(head, stage))
            done = do(stage, work)
            for line in (*done.said, f"took {done.seconds:.0f} s"):
                work.report(f"{INDENT}{line}".rstrip())
        else:
            done = read_stage(stage.name, work.folder)
            work.report(f"{head}: {describe_kept(done)}")
        results[stage.name] = done
    return results


def begin(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> set[str]:
    """Take hold of the folder, and return the names of the stages that are to be done.

    Raises:
        OutputExists: the folder holds something else, or the same work with another plan or by other code.
    """
    claim(work)
    check_code(stages, work)
    missing: set[str] = set()  # a stage that is done anew leaves those that build on it behind
    for stage in stages:
        behind = missing if stage.builds_on is None else missing & set(stage.builds_on)
        if behind or read_done(stage, work.folder) is None:
            missing.add(stage.name)
    return missing


def introduction(head: str, stage: Stage[Plan]) -> str:
    """Return what is said of a stage when it begins."""
    return "\n".join([head, textwrap.fill(stage.does, WIDTH, initial_indent=INDENT, subsequent_indent=INDENT)])


def describe_kept(done: Done) -> str:
    """Return what is said of a stage that an earlier run did."""
    return f"done before, in {done.seconds:.0f} s; kept"


def claim(work: Work[Plan]) -> None:
    """Make the folder this work's own.

    Raises:
        OutputExists: it holds something else, or the same work with another plan.
    """
    path = work.folder / PLAN
    plan = json.loads(json.dumps(work.plan.describe()))
    if path.is_file():
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
    elif work.folder.exists() and (not work.folder.is_dir() or any(work.folder.iterdir())):
        raise OutputExists(f"{work.folder} exists and is no {work.name}; choose another --out.")
    else:
        write_whole(path, (json.dumps(plan, indent=1) + "\n").encode())


def check_code(stages: Sequence[Stage[Plan]], work: Work[Plan]) -> None:
    """Refuse what other code did, before anything is built on it.

    Raises:
        OutputExists: other code did one of the stages.
    """
    for stage in stages:
        done = read_done(stage, work.folder)
        if done is not None and stage.code is not None and done.code != stage.code(work.plan):
            raise OutputExists(
                f"{work.folder} holds '{stage.title}' by other code of nas_data: what decides it was changed since; "
                f"remove {work.folder / STAGES / stage.name}.json to have it made anew, with all that builds on it, "
                "or choose another --out."
            )


def do(stage: Stage[Plan], work: Work[Plan]) -> Done:
    """Do a stage and keep what it found."""
    began, cpu = time.monotonic(), cpu_seconds()
    code = "" if stage.code is None else stage.code(work.plan)
    found = stage.work(work)
    done = Done(
        seconds=round(time.monotonic() - began, 2),
        cpu_seconds=round(cpu_seconds() - cpu, 2),
        code=code,
        commit=commit(),
        when=now(),
        load=round(os.getloadavg()[0], 1),
        said=tuple(found.said),
        data=found.data,
        summary=tuple(found.summary),
    )
    write_whole(work.folder / STAGES / f"{stage.name}.json", (json.dumps(asdict(done), indent=1) + "\n").encode())
    return done


def cpu_seconds() -> float:
    """Return the processor time of this process and of those that it started and that have ended [s]."""
    return sum(os.times()[:4])


def read_done(stage: Stage[Plan], folder: Path) -> Done | None:
    """Return what a stage found in an earlier run; None where it has to be done."""
    if not all((folder / path).exists() for path in stage.made):
        return None
    try:
        return read_stage(stage.name, folder)
    except (OSError, ValueError, TypeError):
        return None


def read_stage(name: str, folder: Path) -> Done:
    """Return what a finished stage found; raises what reading its file does."""
    return Done(**json.loads((folder / STAGES / f"{name}.json").read_text(encoding="utf-8")))
