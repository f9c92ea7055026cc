"""PPO in the augmented environment, compared with plain environments and environments with one network each."""

import copy
import sys
from collections.abc import Callable
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import torch
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

from nas_data.benchmarks.result import BenchmarkResult, Ratio, Work, take_turns
from nas_data.envs.ergo_reacher import ACTIVE, ANGLE, CENTRE, MAX_Y, MAX_Z, NO_LOAD_SPEED, REACHED, TASK, TIP
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.errors import OptionError
from nas_data.models.augmented import AugmentedStepper
from nas_data.models.lstm import DynamicsModel
from nas_data.policies.policy import Hyperparameters
from nas_data.policies.ppo import make_silent_ppo
from nas_data.simulators.mujoco import MujocoSimulator

SUBSTEPS = 5  # of 2 ms


class GymReacher(gymnasium.Env[np.ndarray, np.ndarray]):
    """One arm, one `MjData`: the same episodes, rewards and observations as `nas/ErgoReacher-v0`.

    It is leaner than a subclass of Gymnasium's `MujocoEnv`, which computes unused contact forces, so that the cost is
    not overestimated.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (not a ClassVar: Gymnasium's base class declares it as it is)

    def __init__(self, model: mujoco.MjModel) -> None:
        """Store the compiled model, which several environments may share."""
        self.model = model
        self.data = mujoco.MjData(model)
        self.tip = self.data.site(TIP).xpos
        self.goal = np.zeros(3)
        self.observation_space, self.action_space = TASK.observation_space, TASK.action_space
        self._observation = np.zeros(10)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Begin an episode; return observation and info, as in Gymnasium."""
        super().reset(seed=seed)
        start = TASK.start(self.np_random)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = np.split(start.state, 2)
        self.goal = start.goal
        offset = start.goal - CENTRE
        self._observation[8:] = offset[1] / MAX_Y, 2.0 * offset[2] / MAX_Z - 1.0
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Hold the commands for one control period; return what `gymnasium.Env.step` does."""
        self.data.ctrl[ACTIVE] = action * ANGLE
        self._move()
        mujoco.mj_kinematics(self.model, self.data)  # mj_step leaves site positions of the previous physics step
        offset = self.tip - self.goal
        distance = float(np.sqrt(offset @ offset))
        reached = distance < REACHED
        return self._observe(), reached - distance, reached, False, {}

    def _move(self) -> None:
        mujoco.mj_step(self.model, self.data, nstep=SUBSTEPS)

    def _observe(self) -> np.ndarray:
        observation = self._observation
        observation[:4] = self.data.qpos[ACTIVE] / ANGLE
        observation[4:8] = self.data.qvel[ACTIVE] / NO_LOAD_SPEED
        return np.clip(observation, TASK.observation_space.low, TASK.observation_space.high).astype(np.float32)


class NaiveReacher(GymReacher):
    """`GymReacher` with φ as in the authors' code: one network per environment, called for one arm at a time."""

    def __init__(self, model: mujoco.MjModel, phi: DynamicsModel) -> None:
        """Store the source model and a copy of φ."""
        super().__init__(model)
        self.phi = copy.deepcopy(phi)
        self.memory = self.phi.initial_memory(1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Begin an episode with the network's hidden state zeroed."""
        self.memory = self.phi.initial_memory(1)
        return super().reset(seed=seed, options=options)

    def _move(self) -> None:
        state, command = self._state(), torch.from_numpy(self.data.ctrl.astype(np.float32))[None, None]
        super()._move()
        with torch.no_grad():
            change, self.memory = self.phi.changes(state, command, self._state(), self.memory)
        positions, velocities = np.split(change[0, 0].numpy(), 2)
        self.data.qpos += positions
        self.data.qvel += velocities

    def _state(self) -> torch.Tensor:
        return torch.from_numpy(np.concatenate([self.data.qpos, self.data.qvel]).astype(np.float32))[None, None]


def make_dummy_vec_env(make: Callable[[], GymReacher], size: int) -> DummyVecEnv:
    """Return environments as a `DummyVecEnv`, each with a time limit and a monitor."""
    return DummyVecEnv([lambda: Monitor(TimeLimit(make(), TASK.horizon))] * size)


MAX_ARMS = 64  # vectorised environments per side
MINIBATCH = Hyperparameters().rollout // Hyperparameters().minibatches
CORRECTION = 1e-5  # [rad, rad/s] negligible for the motion; larger corrections raise the cost of the physics
GOALS = {"plain_16": 0.9, "plain_64": 1.0, "naive_16": 5.0, "batched_16": 0.8}


def benchmark(scratch: Path, frames: int, rounds: int) -> BenchmarkResult:
    """Time PPO rollouts with their updates, in environments that differ only in how they are stepped.

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
        title=f"PPO on ErgoReacher, rollouts of {frames} frames with their updates; the number is the number of "
        "environments",
        times=take_turns(sides, rounds),
        ratios=tuple(ratios),
        notes=(
            "φ has 3 layers of 128 units and random weights; its corrections are so small that all sides simulate the "
            "same motions, and only the times differ.",
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
