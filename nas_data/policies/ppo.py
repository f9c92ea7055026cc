"""The paper's PPO, resumable in a folder; equal seeds give bit-equal results, with or without interruption."""

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from nas_data.arrays import Array
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import OutputExists, SimulationDiverged
from nas_data.policies import folder as files
from nas_data.policies.actor_critic import ActorCritic
from nas_data.policies.policy import CONFIG, Hyperparameters, read_config
from nas_data.runs.code_hash import hash_code
from nas_data.runs.environment_info import find_commit, read_versions
from nas_data.runs.progress import RateLimited, Report
from nas_data.simulators.base import Stepper


@dataclass(frozen=True)
class PolicyTraining:
    """Definition of a training; equal trainings give bit-equal policies."""

    plant: DynamicsSpec  # dynamics on which the policy trains
    seed: int = 0  # seed of weights, episodes and exploration
    frames: int = 2_000_000  # control steps of the training, rounded up to whole rollouts
    hyperparameters: Hyperparameters = field(default_factory=Hyperparameters)  # hyperparameters of PPO

    @property
    def rollouts(self) -> int:
        """Rollouts that make up the frames."""
        return math.ceil(self.frames / self.hyperparameters.rollout)

    def identity(self) -> dict[str, object]:
        """Return the identity for `config.json`, without the frames; trainings with equal identities are the same."""
        return {
            "schema": 1,
            "kind": "ppo",
            "plant": self.plant.describe(),
            "seed": self.seed,
            "hyperparameters": {**asdict(self.hyperparameters), "hidden": list(self.hyperparameters.hidden)},
            "code": hash_code(*self.plant.modules(), __name__),
        }

    def circumstances(self) -> dict[str, object]:
        """Return the entries of `config.json` that are not part of the identity."""
        return {
            "checkpoint": self.plant.checkpoint,
            "effects": self.plant.effects,
            "versions": read_versions(),
            "commit": find_commit(),
        }


class Learner:
    """A training in progress.

    Training is divided into segments of a few rollouts. Each segment begins with new episodes and with random
    generators seeded by its number. The state between two segments is therefore networks, optimiser and statistics, and
    a resumed training equals an uninterrupted one.
    """

    SEGMENT = 10  # rollouts; under ten seconds of work is lost when a training is killed

    def __init__(self, training: PolicyTraining, stepper: Stepper) -> None:
        """Build networks and environment on the plant's simulations, one per arm."""
        p = training.hyperparameters
        self.training = training
        self.arms = ArmVecEnv(training.plant.task, stepper)
        self.normalised = VecNormalize(self.arms, gamma=p.discount)
        self.progress: list[files.Row] = []
        self.ppo = make_silent_ppo(self.normalised, p, training.seed)

    @property
    def done(self) -> int:
        """Number of trained rollouts."""
        return len(self.progress)

    def advance(self) -> files.Row:
        """Collect one rollout and learn from it.

        Raises:
            SimulationDiverged: the weights are not finite.
        """
        if self.done % self.SEGMENT == 0:
            self._begin_segment()
        last = self.progress[-1] if self.progress else None
        wall, cpu = time.perf_counter(), time.process_time()
        self.ppo.learn(self.training.hyperparameters.rollout, log_interval=sys.maxsize, reset_num_timesteps=False)
        episodes = self.arms.take_episodes()
        values = self.ppo.logger.name_to_value
        if not all(bool(weight.isfinite().all()) for weight in self.ppo.policy.parameters()):
            raise SimulationDiverged(
                f"PPO's networks are no longer finite after {self.ppo.num_timesteps:,} frames; rewards or observations "
                f"of {self.training.plant.environment} are too large to learn from."
            )
        row = files.Row(
            frames=self.ppo.num_timesteps,
            seconds=time.perf_counter() - wall + (last.seconds if last else 0.0),
            cpu_seconds=time.process_time() - cpu + (last.cpu_seconds if last else 0.0),
            episodes=len(episodes),
            mean_return=mean([episode.total for episode in episodes]),
            success_rate=mean([float(episode.success) for episode in episodes]),
            mean_length=mean([float(episode.length) for episode in episodes]),
            diverged=sum(episode.diverged for episode in episodes),
            action_std=float(values["train/std"]),
            divergence=float(values["train/approx_kl"]),
            value_loss=float(values["train/value_loss"]),
        )
        self.progress.append(row)
        return row

    def _begin_segment(self) -> None:
        number = self.done // self.SEGMENT
        seed = int(np.random.SeedSequence([self.training.seed, number]).generate_state(1)[0])
        set_random_seed(seed)
        self.arms.seed(seed)
        self.arms.take_episodes()
        self.ppo.set_env(self.normalised, force_reset=True)


def make_silent_ppo(environment: VecEnv, p: Hyperparameters, seed: int) -> PPO:
    """Return untrained PPO, silent and on one thread."""
    torch.set_num_threads(1)  # the networks are too small for several threads; other cores train other seeds
    ppo = make_ppo(ActorCritic, environment, p, seed, {"optimizer_kwargs": {"eps": 1e-5, "fused": True}})
    ppo.set_logger(Logger(None, []))
    return ppo


def make_ppo(
    networks: type[ActorCriticPolicy],
    environment: gymnasium.Env[Array, Array] | VecEnv,
    p: Hyperparameters,
    seed: int,
    options: Mapping[str, object],
) -> PPO:
    """Return PPO with these hyperparameters on the CPU; `options` are further arguments of `networks`."""
    return PPO(
        networks,
        environment,
        learning_rate=p.learning_rate,
        n_steps=p.rollout // (environment.num_envs if isinstance(environment, VecEnv) else 1),
        batch_size=p.rollout // p.minibatches,
        n_epochs=p.epochs,
        gamma=p.discount,
        gae_lambda=p.trace,
        clip_range=p.clip,
        ent_coef=p.entropy_weight,
        vf_coef=p.value_weight,
        max_grad_norm=p.gradient_norm,
        policy_kwargs={
            "net_arch": {"pi": list(p.hidden), "vf": list(p.hidden)},
            "activation_fn": torch.nn.Tanh,
            **options,
        },
        seed=seed,
        device="cpu",
    )


def mean(values: list[float]) -> float:
    """Return the mean; NaN for no values."""
    return float(np.mean(values)) if values else math.nan


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
    if learner.done == training.rollouts:  # it was killed between its last two writes
        files.save_policy(learner.ppo, learner.normalised, learner.progress, config, folder)
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
        raise OutputExists(f"{folder} exists and is not a policy folder; choose another --out.")
    held = read_config(folder)
    different = [key for key, value in identity.items() if held.get(key) != value and key != "code"]
    if not different and held.get("code") != identity["code"]:
        raise OutputExists(
            f"{folder} contains a policy trained by another version of nas_data, in which its task, its dynamics or "
            "PPO differ; remove it or choose another --out."
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
    scored = (
        (f"return {row.mean_return:.2f}, success {row.success_rate:.0%}") if row.episodes else "no episode finished yet"
    )
    scored += f", {row.diverged} diverged" if row.diverged else ""
    return (
        f"{row.frames:,} of {total:,} frames, {scored}, {rate:,.0f} frames/s, {(total - row.frames) / rate:.0f} s left"
    )
