"""The blind benchmark: every family on every plant, one JSON file per finished case, which is not run again."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from nas_data.benchmarks.blind.baselines.base import find_baseline
from nas_data.benchmarks.blind.case import DEFAULT, FAMILIES, Identity, Name
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.record import CaseFailure, CaseRecord
from nas_data.benchmarks.blind.run_case import CaseRunner, Investigate, check_code
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.errors import OptionError, UnknownName
from nas_data.gap.side_by_side import on_one_core
from nas_data.runs.job_locks import list_locks
from nas_data.runs.parallel import ONE_WORKER, Workers, run_jobs
from nas_data.runs.progress import format_duration

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


def run(
    plan: BlindPlan,
    out: Path,
    investigate: Investigate,
    report: Callable[[str], None],
    workers: Workers = ONE_WORKER,
) -> list[CaseRecord]:
    """Run every case that is not finished yet and return the records of all.

    Args:
        plan: Cases to run.
        out: `results/` holds one JSON file per finished case, `cases/` their folders.
        investigate: The workflow under test.
        report: Called with a sentence on each case.
        workers: Where the cases run.

    Raises:
        UnknownName, OptionError: the plan cannot be run.
        OutputExists: finished cases were evaluated by other code, or another process works in the folder and the
            workers are not shared.
    """
    plan.check()
    return run_cases(list(plan.identities()), CaseRunner(investigate, plan.baselines, plan.keep), out, report, workers)


@dataclass(frozen=True)
class CaseJob:
    """A case to run."""

    identity: Identity
    runner: CaseRunner
    out: Path  # folder of the benchmark
    one_core: bool  # whether the search uses one core

    @property
    def path(self) -> Path:
        """File of the result."""
        return find_result(self.identity, self.out)


def find_result(identity: Identity, out: Path) -> Path:
    """Return the file of a case's result."""
    return out / RESULTS / f"{identity.name}.json"


def do_case(job: CaseJob) -> CaseRecord:
    """Run a case and store its record, unless another process has done it meanwhile.

    Raises:
        OutputExists: that process has other code.
    """
    record = CaseRecord.read(job.path)
    check_code({job.identity: record} if record else {}, job.out)
    if record is not None and job.runner.is_done(record):
        return record
    with on_one_core() if job.one_core else nullcontext():
        return job.runner.run(job.identity, job.out / FOLDERS / job.identity.name, record).store(job.path)


def run_cases(
    identities: Sequence[Identity],
    runner: CaseRunner,
    out: Path,
    report: Callable[[str], None],
    workers: Workers = ONE_WORKER,
) -> list[CaseRecord]:
    """Run the unfinished ones of some cases and return the records of all; arguments as for `run`."""
    jobs = [CaseJob(identity, runner, out, workers.one_core) for identity in identities]
    known = {job.identity: record for job in jobs if (record := CaseRecord.read(job.path)) is not None}
    check_code(known, out)
    records = {identity: record for identity, record in known.items() if runner.is_done(record)}
    waiting = [job for job in jobs if job.identity not in records]
    began = time.monotonic()
    locks = list_locks(out, [job.identity.name for job in waiting])
    for done, (number, record) in enumerate(run_jobs(do_case, waiting, workers, locks=locks), start=1):
        records[waiting[number].identity] = record
        left = (time.monotonic() - began) / done * (len(waiting) - done)
        report(f"{len(records)} of {len(jobs)}, {format_duration(left)} left: {describe_case(record)}")
    return [records[identity] for identity in identities]


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
