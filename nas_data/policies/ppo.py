"""Resumable PPO training in a folder; equal seeds give bit-equal results, with or without interruption."""

from collections.abc import Mapping
from pathlib import Path

from nas_data.errors import OutputExists
from nas_data.policies import folder as files
from nas_data.policies.learner import Learner, PolicyTraining
from nas_data.policies.policy import CONFIG, read_config
from nas_data.runs.progress import RateLimited, Report
from nas_data.simulators.base import Stepper


def train(training: PolicyTraining, folder: Path, report: Report | None = None, stepper: Stepper | None = None) -> Path:
    """Train a policy, or resume an unfinished training.

    Writes `config.json`, `policy.safetensors`, `progress.csv`, and the state for resuming.

    Args:
        training: The training.
        folder: Its folder: new, or with the same training and no more frames.
        report: Called with a sentence after each rollout; None for stderr every two seconds.
        stepper: Simulations to train on, instead of the plant's own.

    Returns:
        The folder.

    Raises:
        OutputExists: the folder holds another training or one of more frames.
        UnknownName: there is no such environment or dynamics.
        CheckpointError: the plant's checkpoint, or the unfinished training, cannot be used.
    """
    identity = training.identity()
    if count_trained_rollouts(folder, training, identity) == training.rollouts:
        return folder
    files.clear_half_saved(folder)
    arms = training.hyperparameters.arms
    learner = Learner(training, stepper or training.plant.stepper(arms))
    files.resume(learner.ppo, learner.normalised, learner.progress, folder)
    report = report or RateLimited()
    config = identity | training.circumstances()
    while learner.done < training.rollouts:
        row = learner.advance()
        report(f"seed {training.seed}: {describe_training_progress(row, training)}")
        if learner.done % Learner.SEGMENT == 0:
            files.save_state(learner.ppo, learner.normalised, learner.progress, folder)
        if learner.done % Learner.SEGMENT == 0 or learner.done == training.rollouts:
            files.save_policy(learner.ppo, learner.normalised, learner.progress, config, folder)
    return folder


def train_job(job: tuple[PolicyTraining, Path]) -> Path:
    """Train a policy into a folder; `train` as one of several jobs."""
    return train(*job)


def check_folder(folder: Path, training: PolicyTraining) -> None:
    """Refuse a folder that holds something else than this training.

    Raises:
        OutputExists: the folder holds something else.
    """
    count_trained_rollouts(folder, training, training.identity())


def count_trained_rollouts(folder: Path, training: PolicyTraining, identity: Mapping[str, object]) -> int:
    """Return the number of trained rollouts of a folder's policy; 0 for a new folder.

    Raises:
        OutputExists: the folder holds something else.
    """
    if files.is_vacant(folder):
        return 0
    if not (folder / CONFIG).is_file():
        raise OutputExists(f"{folder} exists and holds no policy; choose another --out.")
    held = read_config(folder)
    different = [key for key, value in identity.items() if held.get(key) != value and key != "code"]
    if not different and held.get("code") != identity["code"]:
        raise OutputExists(
            f"{folder} holds a policy that other code of nas_data trained: its task, its dynamics or PPO were changed "
            "since; remove it or choose another --out."
        )
    if different:
        raise OutputExists(
            f"{folder} holds another training (it differs in: {', '.join(different)}); choose another --out."
        )
    frames = int(str(held["frames"]))
    rollouts = frames // training.hyperparameters.rollout
    if rollouts > training.rollouts:
        raise OutputExists(f"{folder} holds a policy of {frames} frames, more than asked for; choose another --out.")
    return rollouts


def describe_training_progress(row: files.Row, training: PolicyTraining) -> str:
    """Return a sentence on the progress of a training."""
    total = training.rollouts * training.hyperparameters.rollout
    rate = row.frames / row.seconds
    scored = f"return {row.mean_return:.2f}, success {row.success_rate:.0%}" if row.episodes else "no episode over yet"
    scored += f", {row.diverged} diverged" if row.diverged else ""
    return (
        f"{row.frames:,} of {total:,} frames, {scored}, {rate:,.0f} frames/s, {(total - row.frames) / rate:.0f} s left"
    )
