"""Stages that are done once: what each found is kept in a file, and a later run reads it instead of working again."""

import json
import os
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from nas_data.dataset.provenance import now
from nas_data.demo.plan import Plan
from nas_data.errors import OutputExists
from nas_data.reports.file import write_whole

PLAN = "plan.json"
STAGES = "stages"
WIDTH, INDENT = 110, " " * 6  # of what people read while it runs

Report = Callable[[str], None]


@dataclass(frozen=True)
class Demo:
    """A demo in a folder.

    Attributes:
        plan: Its sizes.
        folder: Where everything lies.
        report: Told of progress, in lines for people.
    """

    plan: Plan
    folder: Path
    report: Report


@dataclass(frozen=True)
class Found:
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
class Stage:
    """A part of the demo.

    Attributes:
        name: File in which what it found is kept.
        title: What it is, in a few words.
        does: What it does, in a sentence or two for newcomers.
        work: Does it.
        made: Paths in the demo's folder without which it must be done again.
    """

    name: str
    title: str
    does: str
    work: Callable[[Demo], Found]
    made: Sequence[str] = ()


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
    """

    seconds: float
    when: str
    load: float
    said: Sequence[str]
    data: Mapping[str, object]
    summary: Sequence[str]


def run_stages(stages: Sequence[Stage], demo: Demo) -> dict[str, Done]:
    """Do each stage that is not done yet, in order.

    Returns:
        What each found.

    Raises:
        OutputExists: the folder holds something else, or a demo of other sizes.
    """
    claim(demo)
    results: dict[str, Done] = {}
    fresh = False  # a stage that was done anew leaves those after it behind
    for number, stage in enumerate(stages, start=1):
        head = f"[{number}/{len(stages)}] {stage.title}"
        done = None if fresh else read_done(stage, demo.folder)
        if done is None:
            fresh = True
            demo.report(head)
            demo.report(textwrap.fill(stage.does, WIDTH, initial_indent=INDENT, subsequent_indent=INDENT))
            done = do(stage, demo)
            for line in (*done.said, f"took {done.seconds:.0f} s"):
                demo.report(f"{INDENT}{line}".rstrip())
        else:
            demo.report(f"{head}: done before, in {done.seconds:.0f} s; kept")
        results[stage.name] = done
    return results


def claim(demo: Demo) -> None:
    """Make the folder this demo's own.

    Raises:
        OutputExists: it holds something else, or a demo of other sizes.
    """
    path = demo.folder / PLAN
    plan = json.loads(json.dumps(demo.plan.describe()))
    if path.is_file():
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            held = {}
        different = [key for key in plan if held.get(key) != plan[key]]
        if different:
            raise OutputExists(
                f"{demo.folder} holds a demo that differs in {', '.join(different)}; remove it or choose another --out."
            )
    elif demo.folder.exists() and (not demo.folder.is_dir() or any(demo.folder.iterdir())):
        raise OutputExists(f"{demo.folder} exists and is no demo; choose another --out.")
    else:
        write_whole(path, (json.dumps(plan, indent=1) + "\n").encode())


def do(stage: Stage, demo: Demo) -> Done:
    """Do a stage and keep what it found."""
    began = time.monotonic()
    found = stage.work(demo)
    done = Done(
        seconds=round(time.monotonic() - began, 2),
        when=now(),
        load=round(os.getloadavg()[0], 1),
        said=tuple(found.said),
        data=found.data,
        summary=tuple(found.summary),
    )
    write_whole(demo.folder / STAGES / f"{stage.name}.json", (json.dumps(asdict(done), indent=1) + "\n").encode())
    return done


def read_done(stage: Stage, folder: Path) -> Done | None:
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
