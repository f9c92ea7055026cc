"""Cases of the blind benchmark as planned jobs."""

from pathlib import Path

from nas_data.benchmarks.blind.benchmark import RESULTS, BlindPlan
from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.record import CaseRecord, GradedCase
from nas_data.runs.planned_jobs import PlannedJob

ROUGH = {"none": 25.0, "one": 50.0, "two": 90.0, "three": 130.0, "every": 200.0, "outside": 120.0}  # [s] by family
ROUGH_OTHER = 250.0  # [s] a case of another family
ROUGH_BASELINE = 30.0  # [s] a baseline on a case


def plan_cases(plan: BlindPlan, out: Path) -> list[PlannedJob]:
    """Return the cases of a plan as planned jobs."""
    return [plan_case(identity, plan, out) for identity in plan.identities()]


def plan_case(identity: Identity, plan: BlindPlan, out: Path) -> PlannedJob:
    """Return a case as a planned job."""
    record = CaseRecord.read(out / RESULTS / f"{identity.name}.json")
    rough = ROUGH.get(identity.family, ROUGH_OTHER) + ROUGH_BASELINE * len(plan.baselines)
    took = None
    if record is not None and all(name in record.baselines for name in plan.baselines):
        outcome = record.outcome
        took = (record.drawing_seconds or 0.0) + (outcome.seconds if isinstance(outcome, GradedCase) else 0.0)
    return PlannedJob(identity.name, identity.family, rough, took)
