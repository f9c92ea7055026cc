"""Trainings of policies as planned jobs."""

from collections.abc import Sequence
from pathlib import Path

from nas_data.policies.compare import Run, count_trained_frames, read_finished
from nas_data.policies.policy import PolicyResult, read_progress
from nas_data.policies.ppo import PolicyTraining, check_folder
from nas_data.runs.planned_jobs import PlannedJob

# rough times on one core of a desktop computer: medians of docs/results/experiments/runs.csv
POLICY_STEP = 1.4e-4  # [s] control step of a training
EVALUATION = 0.004  # [s] episode of an evaluation
KIND = "policy"


def plan_training(training: PolicyTraining, folder: Path) -> PlannedJob:
    """Return a training as a planned job.

    Raises:
        OutputExists: the folder holds something else.
    """
    check_folder(folder, training)
    frames = training.rollouts * training.hyperparameters.rollout
    is_done = count_trained_frames(folder) >= frames
    took = float(read_progress(folder)["seconds"][-1]) if is_done else None
    return PlannedJob(f"seed {training.seed}", KIND, frames * POLICY_STEP, took)


def plan_policy(name: str, frames: int, episodes: int, result: PolicyResult | None) -> PlannedJob:
    """Return a policy's training and evaluation as a planned job.

    Args:
        name: Name of the job.
        frames: Control steps of the training.
        episodes: Episodes of the evaluation.
        result: Its result; None if it is not finished.
    """
    took = None if result is None else result.wall_seconds + result.judging.wall_seconds
    return PlannedJob(name, KIND, frames * POLICY_STEP + episodes * EVALUATION, took)


def plan_runs(runs: Sequence[Run]) -> list[PlannedJob]:
    """Return the runs of a comparison as planned jobs."""
    return [
        plan_policy(f"{run.method}, seed {run.training.seed}", run.training.frames, run.episodes, read_finished(run))
        for run in runs
    ]
