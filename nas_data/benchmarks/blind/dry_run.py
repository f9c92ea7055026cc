"""Cases of the blind benchmark as planned jobs."""

from collections.abc import Sequence
from pathlib import Path

from nas_data.benchmarks.blind.benchmark import BlindPlan, find_result
from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.record import CaseFailure, CaseRecord
from nas_data.benchmarks.blind.run_case import check_code
from nas_data.runs.planned_jobs import PlannedJob

# Rough times on one core of a desktop computer, near the medians of docs/results/blind.md
ROUGH = {"none": 25.0, "one": 50.0, "two": 90.0, "three": 130.0, "every": 200.0, "outside": 120.0}  # [s] by family
ROUGH_OTHER = 250.0  # [s] a case of another family
ROUGH_BASELINE = 30.0  # [s] a baseline on a case


def plan_cases(plan: BlindPlan, out: Path) -> list[PlannedJob]:
    """Return the cases of a plan as planned jobs.

    Raises:
        UnknownName, OptionError: the plan cannot be run.
        OutputExists: finished cases were evaluated by other code.
    """
    plan.check()
    records = {identity: CaseRecord.read(find_result(identity, out)) for identity in plan.identities()}
    check_code({identity: record for identity, record in records.items() if record}, out)
    return [plan_case(identity, record, plan.baselines) for identity, record in records.items()]


def plan_case(identity: Identity, record: CaseRecord | None, baselines: Sequence[str]) -> PlannedJob:
    """Return a case with its baselines as a planned job."""
    rough = ROUGH.get(identity.family, ROUGH_OTHER) + ROUGH_BASELINE * len(baselines)
    took = None
    if record is not None and all(name in record.baselines for name in baselines):
        outcomes = [record.outcome, *(record.baselines[name].outcome for name in baselines)]
        failed = any(isinstance(outcome, CaseFailure) for outcome in outcomes)
        seconds = [outcome.seconds for outcome in outcomes if not isinstance(outcome, CaseFailure)]
        took = 0.0 if failed else (record.drawing_seconds or 0.0) + sum(seconds)
    return PlannedJob(identity.name, identity.family, rough, took)
