"""The paper's PPO: definition of a training, and its steps."""

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

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
from nas_data.errors import SimulationDiverged
from nas_data.policies import folder as files
from nas_data.policies.actor_critic import ActorCritic
from nas_data.policies.hyperparameters import Hyperparameters
from nas_data.runs.code_hash import hash_code
from nas_data.runs.environment_info import find_commit, read_versions
from nas_data.simulators.base import Stepper

TRAINED_BY = "nas_data.policies.ppo"  # module that runs the steps of this one


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
            "code": hash_code(*self.plant.modules(), TRAINED_BY),
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
        """Build networks and environment.

        Args:
            training: The training.
            stepper: The plant's simulations, one per arm.
        """
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
    """Return PPO that has learned nothing yet, silent and on one thread."""
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
