"""PPO in the augmented environment, compared with plain environments and environments with one network each."""

import sys
from collections.abc import Callable
from pathlib import Path

import torch
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from nas_data.benchmarks.gym_reacher import GymReacher, NaiveReacher, make_dummy_vec_env
from nas_data.benchmarks.result import BenchmarkResult
from nas_data.benchmarks.rounds import Ratio, Work, take_turns
from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.errors import OptionError
from nas_data.models.augmented import AugmentedStepper
from nas_data.models.lstm import DynamicsModel
from nas_data.policies.hyperparameters import Hyperparameters
from nas_data.policies.learner import make_silent_ppo
from nas_data.simulators.mujoco import MujocoSimulator

MAX_ARMS = 64  # environments of a side
MINIBATCH = Hyperparameters().rollout // Hyperparameters().minibatches
CORRECTION = 1e-5  # [rad, rad/s] so small that the arm moves as without φ: larger ones make the physics work more
GOALS = {"plain_16": 0.9, "plain_64": 1.0, "naive_16": 5.0, "batched_16": 0.8}


def benchmark(scratch: Path, frames: int, rounds: int) -> BenchmarkResult:
    """Time rollouts of PPO with their updates, in environments that differ only in how they are stepped.

    Args:
        scratch: Unused.
        frames: Frames of a rollout, over all environments of a side.
        rounds: Number of timed rounds.

    Raises:
        OptionError: a rollout is too short for each environment to take a step.
    """
    if frames < MAX_ARMS:
        raise OptionError(f"--frames is {frames}; at least {MAX_ARMS} are needed, one for each environment.")
    phi, simulator = make_random_phi(), MujocoSimulator.load(TASK.robot, TASK.period, TASK.joints)

    def augmented(size: int) -> VecEnv:
        return ArmVecEnv(TASK, AugmentedStepper(simulator.stepper(size), phi))

    environments: dict[str, Callable[[], VecEnv]] = {
        "augmented_16": lambda: augmented(16),
        "plain_16": lambda: make_dummy_vec_env(lambda: GymReacher(simulator.model), 16),
        "naive_16": lambda: make_dummy_vec_env(lambda: NaiveReacher(simulator.model, phi), 16),
        "batched_16": lambda: ArmVecEnv(TASK, simulator.stepper(16)),
        "augmented_64": lambda: augmented(64),
        "plain_64": lambda: make_dummy_vec_env(lambda: GymReacher(simulator.model), 64),
    }
    sides = {name: make_ppo_update(make(), frames) for name, make in environments.items()}
    ratios = [
        Ratio(f"augmented_vs_{name}", f"augmented_{name.rpartition('_')[2]}", name, wanted, "cpu")
        for name, wanted in GOALS.items()
    ]
    return BenchmarkResult(
        title=f"PPO on ErgoReacher, rollouts of {frames} frames with their updates; the number is that of environments",
        times=take_turns(sides, rounds),
        ratios=tuple(ratios),
        notes=(
            "φ has 3 layers of 128 units and random weights; what it adds is so small that all sides simulate the same "
            "motions, and what is compared is how.",
            "'plain': stable-baselines3's DummyVecEnv of Gymnasium environments; 'naive': the same with a torch "
            "network in each; 'batched': our environment without φ.",
        ),
    )


def make_random_phi() -> DynamicsModel:
    """Return φ of the paper's size with random weights and a tiny output."""
    torch.manual_seed(0)
    phi = DynamicsModel("delta", TASK.joints, fps=1 / TASK.period)
    phi.get_buffer("output_std").fill_(CORRECTION)
    return phi.eval().requires_grad_(False)


def make_ppo_update(environment: VecEnv, frames: int) -> Work:
    """Return a function that does one rollout and one PPO update per call."""
    p = Hyperparameters(arms=environment.num_envs, rollout=frames, minibatches=max(1, frames // MINIBATCH))
    ppo = make_silent_ppo(VecNormalize(environment, gamma=p.discount), p, seed=0)

    def work() -> int:
        before = ppo.num_timesteps
        ppo.learn(frames, log_interval=sys.maxsize, reset_num_timesteps=before == 0)
        return ppo.num_timesteps - before

    return work
