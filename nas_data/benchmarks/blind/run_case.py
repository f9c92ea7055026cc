"""Run one case from drawing to grading, and hash the code that determines its result."""

import shutil
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from nas_data.benchmarks.blind.baselines.base import find_baseline
from nas_data.benchmarks.blind.case import Identity, SealedAnswer
from nas_data.benchmarks.blind.catalogue import OUTSIDE
from nas_data.benchmarks.blind.draw import SCREEN, draw_case
from nas_data.benchmarks.blind.fresh import Fresh, FreshErrors, compute_oracle_error
from nas_data.benchmarks.blind.grade import compare_names, grade_names
from nas_data.benchmarks.blind.plants.base import SUFFIX
from nas_data.benchmarks.blind.record import BaselineRecord, CaseFailure, CaseRecord, GradedAnswer, GradedCase
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.write import DATASET, NOMINAL, write_case
from nas_data.count_of import count_of
from nas_data.dataset.layout import read_json
from nas_data.errors import OutputExists
from nas_data.runs.code_hash import hash_code, list_gap_modules
from nas_data.runs.environment_info import find_commit


def hash_case_code(identity: Identity) -> str:
    """Return the hash of the code that draws, simulates, identifies and grades a case."""
    played_on = {identity.plant, SCREEN, find_setting(identity.setting).screen}
    plants = (f"nas_data.benchmarks.blind.plants.{plant}{SUFFIX}" for plant in played_on)
    setting = f"nas_data.benchmarks.blind.settings.{identity.setting}"
    return hash_code(*list_gap_modules(), *plants, setting, "nas_data.benchmarks.blind.run_case")


def hash_baseline_code(name: str) -> str:
    """Return the hash of a baseline's code; the code that grades it is part of the case's hash."""
    return hash_code(f"nas_data.benchmarks.blind.baselines.{name}")


def check_code(records: Mapping[Identity, CaseRecord], folder: Path) -> None:
    """Refuse records of other code versions, before hours are spent.

    Raises:
        OutputExists: some records come from other code, or do not name their code.
    """
    other = [record for identity, record in records.items() if not is_by_this_code(identity, record)]
    if other:
        raise OutputExists(
            f"{folder} holds {count_of(len(other), 'case')} graded by another version of nas_data "
            f"({format_commits(other)}): the search, the cases or the grading have changed; "
            f"remove {folder} or choose another --out."
        )


def is_by_this_code(identity: Identity, record: CaseRecord) -> bool:
    """Whether a case and all baselines on it come from the present code."""
    same = all(answer.code == hash_baseline_code(name) for name, answer in record.baselines.items())
    return same and record.code == hash_case_code(identity)


def format_commits(records: Sequence[CaseRecord]) -> str:
    """Name the commits of records."""
    commits = sorted({record.commit[:12] for record in records if record.commit})
    return f"commit {', '.join(commits)}" if commits else "commit unknown"


Investigate = Callable[[Path, Path, Path], None]  # dataset, nominal model, folder of the report
Outcome = TypeVar("Outcome")
REPORT, MODEL = "report.json", "model.xml"
FOUND = "found"  # the workflow's folder within that of the case


@dataclass(frozen=True)
class CaseRunner:
    """Runs and grades cases."""

    investigate: Investigate  # the workflow under test
    baselines: tuple[str, ...] = ()  # names of the baselines that get the same cases
    keep: bool = False  # whether to keep the datasets

    def is_done(self, record: CaseRecord) -> bool:
        """Whether a record holds all requested results."""
        return not self._list_missing_baselines(record)

    def run(self, identity: Identity, folder: Path, known: CaseRecord | None = None) -> CaseRecord:
        """Draw, write, investigate and grade one case.

        Args:
            identity: Identity of the case.
            folder: Output folder; emptied first, except for the workflow's files of an earlier run.
            known: Its record, if only baselines are missing.
        """
        began = time.monotonic()
        case = draw_case(**vars(identity))
        drawing = time.monotonic() - began
        for name in (DATASET, *((FOUND,) if known is None else ())):
            shutil.rmtree(folder / name, ignore_errors=True)
        write_case(case, folder)
        answer = case.answer()
        fresh = Fresh.load(folder, case.arm.joints)
        record = known or CaseRecord(
            case=answer.case,
            identity=identity,
            arm=answer.arm,
            excitation=answer.excitation,
            code=hash_case_code(identity),
            commit=find_commit(),
            drawing_seconds=drawing,
            outcome=attempt(lambda: examine(folder, answer, fresh, self.investigate)),
        )
        answered = {
            name: BaselineRecord(attempt(partial(run_baseline, name, folder, answer, fresh)), hash_baseline_code(name))
            for name in self._list_missing_baselines(record)
        }
        if not self.keep:
            shutil.rmtree(folder / DATASET)
        return replace(record, baselines={**record.baselines, **answered})

    def _list_missing_baselines(self, record: CaseRecord) -> list[str]:
        return [name for name in self.baselines if name not in record.baselines]


def examine(folder: Path, answer: SealedAnswer, fresh: Fresh, investigate: Investigate) -> GradedCase:
    """Run the workflow under test and grade its `report.json` and `model.xml`; other files are ignored."""
    found = folder / FOUND
    began = time.monotonic()
    investigate(folder / DATASET, folder / NOMINAL, found)
    seconds = time.monotonic() - began
    grade = grade_names(answer, read_json(found / REPORT))
    least = compute_oracle_error(folder, answer, fresh)
    return GradedCase(grade, seconds, fresh.errors_of_models(folder, found / MODEL, least))


def run_baseline(name: str, folder: Path, answer: SealedAnswer, fresh: Fresh) -> GradedAnswer:
    """Run one baseline; grade its names and its prediction of the fresh episodes."""
    began = time.monotonic()
    claim = find_baseline(name)(folder / DATASET, folder / NOMINAL)
    seconds = time.monotonic() - began
    true = tuple(entry.name for entry in answer.effects if entry.effect not in OUTSIDE)
    return GradedAnswer(
        grade=compare_names(true, claim.findings),
        true=true,
        named=tuple(finding.name for finding in claim.findings),
        seconds=seconds,
        fresh=FreshErrors(after=fresh.error(claim.predict), floor=fresh.floor),
    )


def attempt(work: Callable[[], Outcome]) -> Outcome | CaseFailure:
    """Return the result of `work`; an error is a result as well, so that the benchmark continues."""
    try:
        return work()
    except Exception as error:  # any error of the workflow under test counts as its result
        where = traceback.extract_tb(error.__traceback__)[-1]
        return CaseFailure(f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})")
