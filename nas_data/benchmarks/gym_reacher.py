"""ErgoReacher as a usual Gymnasium environment, plain or with a learned correction."""

import copy
from collections.abc import Callable

import gymnasium
import mujoco
import numpy as np
import torch
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from nas_data.envs.ergo_reacher import ACTIVE, ANGLE, CENTRE, MAX_Y, MAX_Z, NO_LOAD_SPEED, REACHED, TASK, TIP
from nas_data.models.lstm import DynamicsModel

SUBSTEPS = 5  # of 2 ms


class GymReacher(gymnasium.Env[np.ndarray, np.ndarray]):
    """One arm, one `MjData`: the same episodes, rewards and observations as `nas/ErgoReacher-v0`.

    It is leaner than a subclass of Gymnasium's `MujocoEnv`, which computes unused contact forces, so that the cost is
    not overestimated.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (not a ClassVar: Gymnasium's base class declares it as it is)

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the compiled model; several environments may share it."""
        self.model = model
        self.data = mujoco.MjData(model)
        self.tip = self.data.site(TIP).xpos
        self.goal = np.zeros(3)
        self.observation_space, self.action_space = TASK.observation_space, TASK.action_space
        self._observation = np.zeros(10)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Begin an episode."""
        super().reset(seed=seed)
        start = TASK.start(self.np_random)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = np.split(start.state, 2)
        self.goal = start.goal
        offset = start.goal - CENTRE
        self._observation[8:] = offset[1] / MAX_Y, 2.0 * offset[2] / MAX_Z - 1.0
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Hold the commands for one control period."""
        self.data.ctrl[ACTIVE] = action * ANGLE
        self._move()
        mujoco.mj_kinematics(self.model, self.data)  # after mj_step, sites are where they were a physics step ago
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
    """The same with φ as in the authors' code: one network per environment, called for one arm at a time."""

    def __init__(self, model: mujoco.MjModel, phi: DynamicsModel) -> None:
        """Take the source and a copy of φ."""
        super().__init__(model)
        self.phi = copy.deepcopy(phi)
        self.memory = self.phi.initial_memory(1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Begin an episode, the network's memory zeroed."""
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
