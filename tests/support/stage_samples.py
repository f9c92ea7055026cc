"""Stages that wait for each other or fail, where worker processes find them."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

from nas_data.errors import SimulationDiverged
from nas_data.runs.stages import Part, Stage, StageResult, Work, do_part

PATIENCE = 60.0  # [s] to wait for another process


@dataclass(frozen=True)
class Plan:
    """Which stage fails, and which wait for each other."""

    fails: str = ""
    meet: tuple[str, ...] = ()

    def describe(self) -> dict[str, object]:
        return {}


def working(name: str):
    def work(job: Work[Plan]) -> StageResult:
        began = time.time()
        if name == job.plan.fails:
            raise SimulationDiverged(f"{name} cannot be done.")
        (job.folder / f"{name}.begun").touch()
        for other in job.plan.meet if name in job.plan.meet else ():
            while not (job.folder / f"{other}.begun").exists():
                assert time.time() - began < PATIENCE, "it is not begun beside the other"
                time.sleep(0.01)
        (job.folder / name).write_text(str(job.threads))
        job.report(f"{name} works")
        return StageResult([f"{name} is done"], {"began": began, "ended": time.time()})

    return work


def staged(name: str, *builds_on: str) -> Stage[Plan]:
    return Stage(name, f"Stage {name}", "does something", working(name), (name,), builds_on)


ALL = {
    stage.name: stage
    for stage in (staged("root"), staged("left", "root"), staged("right", "root"), staged("on_left", "root", "left"))
}


def do_one(part: Part[Plan]) -> None:
    do_part(ALL[part.stage], part)


def write_and_wait(job: tuple[Path, str]) -> None:
    """Write this process's number to a file, and work for long."""
    folder, name = job
    (folder / name).write_text(str(os.getpid()))
    time.sleep(100)
