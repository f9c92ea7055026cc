"""PPO as the paper trained it, resumable: same seed, same bits, interrupted or not."""

import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.envs.loop.plant import Plant
from nas_data.errors import OutputExists
from nas_data.policies import folder as files
from nas_data.policies.policy import CONFIG, read_config
from nas_data.simulators.base import Stepper

Report = Callable[[str], None]


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's PPO; 16 arms share one rollout of its robot experiments' length (4 processes of 2048 steps).

    Attributes:
        arms: Simulations stepped together.
        rollout: Frames between two updates, over all arms.
        minibatches: Parts of a rollout, one gradient step each.
        epochs: Passes over a rollout.
        learning_rate: Adam's.
        discount: γ.
        trace: λ of the advantage estimate.
        clip: Largest change of an action's probability ratio.
        entropy_weight: Weight of the entropy in the loss.
        value_weight: Weight of the value error in the loss.
        gradient_norm: Longer gradients are cut to this.
        hidden: Widths of the tanh layers, separate for actor and critic.
    """

    arms: int = 16
    rollout: int = 8192
    minibatches: int = 32
    epochs: int = 10
    learning_rate: float = 3e-4
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy_weight: float = 0.0
    value_weight: float = 0.5
    gradient_norm: float = 0.5
    hidden: tuple[int, ...] = (64, 64)


@dataclass(frozen=True)
class Training:
    """What makes a training what it is; equal trainings give equal bits.

    Attributes:
        plant: Where the policy learns.
        seed: Of weights, episodes and exploration.
        frames: Control steps to learn from; rounded up to whole rollouts.
        hyperparameters: PPO's.
    """

    plant: Plant
    seed: int = 0
    frames: int = 2_000_000
    hyperparameters: Hyperparameters = field(default_factory=Hyperparameters)

    @property
    def rollouts(self) -> int:
        """Rollouts that make up the frames."""
        return math.ceil(self.frames / self.hyperparameters.rollout)

    def identity(self) -> dict[str, object]:
        """Return what `config.json` records of it, the frames apart: two trainings are the same where this is."""
        return {
            "schema": 1,
            "kind": "ppo",
            "plant": self.plant.describe(),
            "seed": self.seed,
            "hyperparameters": {**asdict(self.hyperparameters), "hidden": list(self.hyperparameters.hidden)},
        }

    def circumstances(self) -> dict[str, object]:
        """Return what `config.json` records beside the identity."""
        packages = ("nas_data", "mujoco", "numpy", "stable_baselines3", "torch")
        return {
            "checkpoint": self.plant.checkpoint,
            "effects": self.plant.effects,
            "versions": {name: version(name) for name in packages},
        }


class Learner:
    """A training in progress.

    Training is cut into segments of a few rollouts. Each begins with fresh episodes and with random generators seeded
    by its number alone, so that the state between two segments is the networks, the optimiser and the statistics, and
    a training that goes on from there does the same as one that never stopped.
    """

    SEGMENT = 10  # rollouts; under ten seconds of work is lost when a training is killed

    def __init__(self, training: Training, stepper: Stepper) -> None:
        """Build networks and environment.

        Args:
            training: What to train.
            stepper: The plant's simulations, as many as there are arms.
        """
        p = training.hyperparameters
        self.training = training
        self.arms = ArmVecEnv(training.plant.task, stepper)
        self.normalised = VecNormalize(self.arms, gamma=p.discount)
        self.progress: list[files.Row] = []
        self.ppo = new_ppo(self.normalised, p, training.seed)

    @property
    def done(self) -> int:
        """Rollouts learned from."""
        return len(self.progress)

    def advance(self) -> files.Row:
        """Collect one rollout and learn from it."""
        if self.done % self.SEGMENT == 0:
            self._begin_segment()
        last = self.progress[-1] if self.progress else None
        wall, cpu = time.perf_counter(), time.process_time()
        self.ppo.learn(self.training.hyperparameters.rollout, log_interval=sys.maxsize, reset_num_timesteps=False)
        episodes = self.arms.take_episodes()
        values = self.ppo.logger.name_to_value
        row = files.Row(
            frames=self.ppo.num_timesteps,
            seconds=time.perf_counter() - wall + (last.seconds if last else 0.0),
            cpu_seconds=time.process_time() - cpu + (last.cpu_seconds if last else 0.0),
            episodes=len(episodes),
            mean_return=mean([episode.total for episode in episodes]),
            success_rate=mean([float(episode.success) for episode in episodes]),
            mean_length=mean([float(episode.length) for episode in episodes]),
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


def new_ppo(environment: VecEnv, p: Hyperparameters, seed: int) -> PPO:
    """Return PPO that has learned nothing yet, silent and on one thread."""
    torch.set_num_threads(1)  # the networks are too small to share, and the other cores have other seeds to train
    ppo = PPO(
        "MlpPolicy",
        environment,
        learning_rate=p.learning_rate,
        n_steps=p.rollout // p.arms,
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
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},
        },
        seed=seed,
        device="cpu",
    )
    ppo.set_logger(Logger(None, []))
    return ppo


def mean(values: list[float]) -> float:
    """Return the mean, NaN where there is nothing."""
    return float(np.mean(values)) if values else math.nan


def train(training: Training, folder: Path, report: Report | None = None, stepper: Stepper | None = None) -> Path:
    """Train a policy, or go on with an unfinished training of the same policy.

    Writes `config.json`, `policy.safetensors`, `progress.csv`, and what is needed to go on.

    Args:
        training: What to train.
        folder: Where it lies; new, or holding the same training with no more frames.
        report: Told of each rollout in a sentence; where None, stderr, every two seconds.
        stepper: Simulations to learn on, instead of the plant's own.

    Returns:
        The folder.

    Raises:
        OutputExists: the folder holds another training or one of more frames.
        UnknownName: there is no such environment or dynamics.
        CheckpointError: the plant's checkpoint, or the unfinished training, cannot be used.
    """
    identity = training.identity()
    if rollouts_in(folder, training, identity) == training.rollouts:
        return folder
    arms = training.hyperparameters.arms
    learner = Learner(training, stepper or training.plant.stepper(arms))
    files.resume(learner.ppo, learner.normalised, learner.progress, folder)
    report = report or Calm()
    config = identity | training.circumstances()
    while learner.done < training.rollouts:
        row = learner.advance()
        report(f"seed {training.seed}: {sentence(row, training)}")
        if learner.done % Learner.SEGMENT == 0:
            files.save_state(learner.ppo, learner.normalised, learner.progress, folder)
        if learner.done % Learner.SEGMENT == 0 or learner.done == training.rollouts:
            files.save_policy(learner.ppo, learner.normalised, learner.progress, config, folder)
    return folder


def train_job(job: tuple[Training, Path]) -> Path:
    """Train a policy into a folder; `train` as one of several jobs."""
    return train(*job)


def rollouts_in(folder: Path, training: Training, identity: Mapping[str, object]) -> int:
    """Return how many rollouts a folder's policy has learned from; 0 for a new folder.

    Raises:
        OutputExists: the folder holds something else.
    """
    if not folder.exists() or not any(folder.iterdir()):
        return 0
    if not (folder / CONFIG).is_file():
        raise OutputExists(f"{folder} exists and holds no policy; choose another --out.")
    held = read_config(folder)
    different = [key for key, value in identity.items() if held.get(key) != value]
    if different:
        raise OutputExists(
            f"{folder} holds another training (it differs in: {', '.join(different)}); choose another --out."
        )
    frames = int(str(held["frames"]))
    rollouts = frames // training.hyperparameters.rollout
    if rollouts > training.rollouts:
        raise OutputExists(f"{folder} holds a policy of {frames} frames, more than asked for; choose another --out.")
    return rollouts


def sentence(row: files.Row, training: Training) -> str:
    """Say where a training stands."""
    total = training.rollouts * training.hyperparameters.rollout
    rate = row.frames / row.seconds
    scored = f"return {row.mean_return:.2f}, success {row.success_rate:.0%}" if row.episodes else "no episode over yet"
    return (
        f"{row.frames:,} of {total:,} frames, {scored}, {rate:,.0f} frames/s, {(total - row.frames) / rate:.0f} s left"
    )


def to_stderr(message: str) -> None:
    """Show a line of progress."""
    print(message, file=sys.stderr, flush=True)


class Calm:
    """A report that passes on no more than one sentence every few seconds."""

    PAUSE = 2.0  # [s]

    def __init__(self, report: Report = to_stderr, pause: float = PAUSE) -> None:
        """Pass on to a report, after at least a pause [s]."""
        self.report = report
        self.pause = pause
        self.next = 0.0

    def __call__(self, message: str) -> None:
        """Report, or say nothing if something was said a moment ago."""
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + self.pause
            self.report(message)
