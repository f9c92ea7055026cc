"""Trials of a sweep as planned jobs."""

from nas_data.dataset.dataset import Dataset
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.sweep import read_result
from nas_data.studies.ablation.sweep_data import Amount
from nas_data.studies.ablation.trial import Trial
from nas_data.studies.rough_times import NAMING, TRAINING_START, estimate_training


def plan_trial(trial: Trial, dataset: Dataset, retry: bool) -> PlannedJob:
    """Return a trial as a planned job; a failed one is done unless it is to be repeated."""
    config, result = trial.config, read_result(trial)
    kind = find_kind(config.kind)
    rough = NAMING if kind.names and trial.material.effects is None else TRAINING_START
    if kind.trains:
        rough += estimate_training(config.options, count_frames(config.amount, dataset))
    took = None
    if result is not None and not (retry and result.failed):
        took = 0.0 if result.failed else result.wall_seconds
    return PlannedJob(f"{config.kind}, {config.amount}, seed {config.seed}", config.kind, rough, took)


def count_frames(amount: Amount, dataset: Dataset) -> float:
    """Return about how many frames an amount of data has."""
    if amount.is_all:
        return dataset.n_frames
    if amount.unit == "minutes":
        return amount.value * 60 * dataset.fps
    return amount.value * dataset.n_frames / dataset.n_episodes
