"""Trials of a sweep as planned jobs."""

from nas_data.runs.planned_jobs import PlannedJob
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.sweep import read_result
from nas_data.studies.ablation.trial import Trial
from nas_data.studies.rough_times import BEGINNING, NAMING, estimate_training


def plan_trial(trial: Trial, retry: bool = False) -> PlannedJob:
    """Return a trial as a planned job; a failed one is done unless it is to be repeated."""
    config, result = trial.config, read_result(trial)
    kind = find_kind(config.kind)
    rough = (NAMING if kind.names and trial.material.effects is None else BEGINNING) + (
        estimate_training(config.options) if kind.trains else 0.0
    )
    done = result is not None and not (retry and result.failed)
    name = f"{config.kind}, {config.amount}, seed {config.seed}"
    return PlannedJob(name, config.kind, rough, result.wall_seconds if result and done else None)
