"""Trainings of policies as planned jobs."""

from pathlib import Path

from nas_data.policies.compare import Study
from nas_data.policies.policy import read_progress, read_result
from nas_data.policies.ppo import PolicyTraining
from nas_data.runs.planned_jobs import PlannedJob

# rough times on one core of a desktop computer
POLICY_STEP = 1.3e-4  # [s] control step of a training
EVALUATION = 0.3  # [s] episode of an evaluation


def plan_training(training: PolicyTraining, folder: Path) -> PlannedJob:
    """Return a training as a planned job."""
    frames = training.rollouts * training.hyperparameters.rollout
    took = None
    if (folder / "config.json").is_file():
        curve = read_progress(folder)
        took = float(curve["seconds"][-1]) if curve["frames"][-1] >= frames else None
    return PlannedJob(f"seed {training.seed}", "policy", frames * POLICY_STEP, took)


def plan_policy(name: str, frames: int, episodes: int, folder: Path) -> PlannedJob:
    """Return a policy's training and evaluation as a planned job.

    Args:
        name: Name of the job.
        frames: Control steps of the training.
        episodes: Episodes of the evaluation.
        folder: Folder of the policy.
    """
    result = read_result(folder)
    took = None if result is None else result.wall_seconds + result.judging.wall_seconds
    return PlannedJob(name, "policy", frames * POLICY_STEP + episodes * EVALUATION, took)


def plan_study(study: Study, folder: Path) -> list[PlannedJob]:
    """Return the runs of a comparison as planned jobs."""
    return [
        plan_policy(f"{method}, seed {seed}", study.frames, study.episodes, folder / method / f"seed{seed}")
        for seed in study.seeds
        for method in study.trained
    ]
