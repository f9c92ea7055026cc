"""The blind benchmark: every family on every plant, one JSON file per finished case, which is not run again."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nas_data.benchmarks.blind.baselines.base import find_baseline
from nas_data.benchmarks.blind.case import DEFAULT, FAMILIES, Identity, Name
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.record import CaseFailure, CaseRecord
from nas_data.benchmarks.blind.run_case import CaseRunner, Investigate, check_code
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.errors import OptionError, UnknownName

RESULTS, FOLDERS = "results", "cases"


@dataclass(frozen=True)
class BlindPlan:
    """Cases and baselines to run."""

    families: tuple[str, ...]  # families of cases
    plants: tuple[str, ...]  # plants that play them
    cases: int  # cases of each family on each plant
    seed: int  # master seed
    faint: bool = False  # whether effects too small to be named may be hidden, for the power curve
    baselines: tuple[str, ...] = ()  # names of the baselines that get the same cases
    keep: bool = False  # whether to keep the datasets
    setting: str = DEFAULT  # setting that the cases are drawn from

    def check(self) -> None:
        """Check the plan before hours are spent.

        Raises:
            UnknownName: there is no such family, plant, baseline or setting.
            OptionError: there is nothing to do.
        """
        for family in self.families:
            if family not in FAMILIES:
                raise UnknownName("family", family, FAMILIES)
        for plant in self.plants:
            find_plant(plant)
        for name in self.baselines:
            find_baseline(name)
        find_setting(self.setting)
        if self.cases < 1 or not self.families or not self.plants:
            raise OptionError("The benchmark needs at least one family, one plant and one case.")

    def identities(self) -> Iterator[Identity]:
        """Yield the cases, alternating between families, so that an interrupted benchmark has some of each."""
        for number in range(self.cases):
            for family in self.families:
                for plant in self.plants:
                    yield Identity(family, plant, number, self.seed, self.faint, self.setting)


def run(plan: BlindPlan, out: Path, investigate: Investigate, report: Callable[[str], None]) -> list[CaseRecord]:
    """Run every case that is not finished yet and return the records of all.

    Args:
        plan: Cases to run.
        out: `results/` holds one JSON file per finished case, `cases/` their folders.
        investigate: The workflow under test.
        report: Called with a sentence on each case.

    Raises:
        UnknownName, OptionError: the plan cannot be run.
        OutputExists: finished cases were evaluated by other code.
    """
    plan.check()
    return run_cases(list(plan.identities()), CaseRunner(investigate, plan.baselines, plan.keep), out, report)


def run_cases(
    identities: Sequence[Identity], runner: CaseRunner, out: Path, report: Callable[[str], None]
) -> list[CaseRecord]:
    """Run the unfinished ones of some cases and return the records of all; arguments as for `run`."""
    paths = {identity: out / RESULTS / f"{identity.name}.json" for identity in identities}
    known = {identity: record for identity, path in paths.items() if (record := CaseRecord.read(path)) is not None}
    check_code(known, out)
    records, began, evaluated = [], time.monotonic(), 0
    for done, (identity, path) in enumerate(paths.items(), start=1):
        record = known.get(identity)
        if record is None or not runner.is_done(record):
            record = runner.run(identity, out / FOLDERS / identity.name, record).store(path)
            evaluated += 1
            left = (time.monotonic() - began) / evaluated * (len(paths) - done)
            report(f"{done} of {len(paths)}, about {left / 60:.0f} min left: {describe_case(record)}")
        records.append(record)
    return records


def describe_case(record: CaseRecord) -> str:
    """Describe a finished case in one line."""
    found = record.outcome
    if isinstance(found, CaseFailure):
        return f"{record.case}: {found.fault}"
    grade, fresh = found.grade, found.fresh
    rest = "no usable model" if fresh.after is None else f"{fresh.after / fresh.floor:.1f} noise floors"
    right = "right" if grade.exact else "CONFIDENTLY WRONG" if grade.confident_wrong else "not exact"
    names = f"{format_effects(grade.true)} → {format_effects(grade.named)}"
    return f"{record.case}: {right}, {grade.verdict}, {rest}, {found.seconds:.0f} s: {names}"


def format_effects(names: Sequence[Name]) -> str:
    """Format effects for a sentence."""
    return ", ".join(f"{effect} {joint}" if joint else effect for effect, joint in names) or "nothing"
