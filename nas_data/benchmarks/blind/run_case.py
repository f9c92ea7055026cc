"""One case from its drawing to its grade: written, investigated, judged, and tidied away."""

import json
import shutil
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from nas_data.benchmarks.blind.answer import SealedAnswer
from nas_data.benchmarks.blind.baselines.base import find_baseline
from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.code import hash_baseline_code, hash_case_code
from nas_data.benchmarks.blind.draw import draw_case
from nas_data.benchmarks.blind.findings import read_mapping
from nas_data.benchmarks.blind.fresh import Fresh
from nas_data.benchmarks.blind.grade import compare_names, grade_names
from nas_data.benchmarks.blind.oracle_error import compute_oracle_error
from nas_data.benchmarks.blind.write import DATASET, NOMINAL, write_case
from nas_data.dataset.layout import read_json
from nas_data.dataset.staging import write_synced
from nas_data.runs.environment_info import find_commit
from nas_data.typed_json import as_object, make_finite

Investigate = Callable[[Path, Path, Path], None]  # dataset, nominal model, folder of the report
Record = dict[str, object]
REPORT, MODEL = "report.json", "model.xml"
FOUND = "found"  # the workflow's folder within a case's
LEAST = "least"  # error on the fresh episodes of who knows the answer
FAILED = "failed"  # verdict of a workflow that raised an error


@dataclass(frozen=True)
class Judge:
    """How cases are judged.

    Attributes:
        investigate: The workflow under test.
        baselines: Names of the baselines that are given the same.
        keep: Whether the datasets stay.
    """

    investigate: Investigate
    baselines: tuple[str, ...] = ()
    keep: bool = False

    def is_done(self, record: Record | None) -> bool:
        """Whether a record holds all that is asked for."""
        return record is not None and not self._list_missing_baselines(record)

    def judge(self, identity: Identity, folder: Path, known: Record | None = None) -> Record:
        """Draw, write, investigate and grade one case.

        Args:
            identity: What names the case.
            folder: Where its files go; emptied first, but for what the workflow found in an earlier run.
            known: Its record, where only baselines are missing.
        """
        began = time.monotonic()
        case = draw_case(**vars(identity))
        drawing = time.monotonic() - began
        for name in (DATASET, *((FOUND,) if known is None else ())):
            shutil.rmtree(folder / name, ignore_errors=True)
        write_case(case, folder)
        answer = case.answer()
        fresh = Fresh.load(folder, case.arm.joints)
        record = known or {
            "case": answer.case,
            **vars(identity),
            "arm": answer.arm,
            "excitation": answer.excitation,
            "code": hash_case_code(identity),
            "commit": find_commit(),
            "drawing_seconds": drawing,
            **attempt(lambda: examine(folder, answer, fresh, self.investigate)),
        }
        answered = {
            name: {**attempt(partial(run_baseline, name, folder, answer, fresh)), "code": hash_baseline_code(name)}
            for name in self._list_missing_baselines(record)
        }
        if not self.keep:
            shutil.rmtree(folder / DATASET)
        return {**record, "baselines": {**read_mapping(record.get("baselines", {})), **answered}}

    def _list_missing_baselines(self, record: Record) -> list[str]:
        answered = read_mapping(record.get("baselines", {}))
        return [name for name in self.baselines if name not in answered]


def examine(folder: Path, answer: SealedAnswer, fresh: Fresh, investigate: Investigate) -> Record:
    """Run the workflow under test and grade what it leaves; only `report.json` and `model.xml` count."""
    found = folder / FOUND
    began = time.monotonic()
    investigate(folder / DATASET, folder / NOMINAL, found)
    seconds = time.monotonic() - began
    grade = grade_names(answer, read_json(found / REPORT))
    errors = {**fresh.errors_of_models(folder, found / MODEL), LEAST: compute_oracle_error(folder, answer, fresh)}
    return {**as_object(grade), "seconds": seconds, "fresh": errors}


def run_baseline(name: str, folder: Path, answer: SealedAnswer, fresh: Fresh) -> Record:
    """Run one baseline and grade what it names, and its prediction of the fresh episodes."""
    began = time.monotonic()
    claim = find_baseline(name)(folder / DATASET, folder / NOMINAL)
    seconds = time.monotonic() - began
    true = [entry.name for entry in answer.effects] if answer.family != "outside" else []
    errors = {"after": fresh.error(claim.predict), "floor": fresh.floor}
    named = [finding.name for finding in claim.findings]
    return {
        **as_object(compare_names(true, claim.findings)),
        "true": true,
        "named": named,
        "seconds": seconds,
        "fresh": errors,
    }


def attempt(work: Callable[[], Record]) -> Record:
    """Return what the work finds; an error is an outcome of the case, and the benchmark goes on."""
    try:
        return work()
    except Exception as error:  # whatever the workflow under test raises is its own doing
        where = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        return {"verdict": FAILED, "exact": False, "fault": fault}


def read_record(path: Path) -> Record | None:
    """Return a finished case's record; None where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def store_record(path: Path, record: Record) -> Record:
    """Store a finished case and return it as it reads back, whole or not at all on the disk."""
    text = json.dumps(make_finite(record), indent=1, allow_nan=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    write_synced(unfinished, text.encode())
    unfinished.replace(path)
    stored: Record = json.loads(text)
    return stored
