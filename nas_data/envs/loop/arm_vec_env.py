"""A task on a batch of simulations as a stable-baselines3 `VecEnv`."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from nas_data.envs.base import Task
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.simulators.base import Stepper

Indices = None | int | Iterable[int]


@dataclass(frozen=True)
class RunningEpisode:
    """Result of an episode.

    Attributes:
        total: Sum of its rewards.
        length: Its control steps.
        success: Whether it reached the goal.
        diverged: Whether it ended because the simulation diverged.
    """

    total: float
    length: int
    success: bool
    diverged: bool


class ArmVecEnv(VecEnv):
    """B arms stepped by one call; finished episodes restart automatically.

    Row i after `seed(s)` has the same episodes as `ArmEnv` after `reset(seed=s + i)`. The info of a finished row holds
    `terminal_observation`, `TimeLimit.truncated`, `is_success` and the `episode`'s return `r` and length `l`.
    `take_episodes` returns the same for many steps at once. A simulation that diverges ends its episode (see
    `TaskBatch`); its last observation is then the previous one.
    """

    def __init__(self, task: Task, stepper: Stepper) -> None:
        """Bring a task and B simulations together.

        Raises:
            JointMismatch: the simulations have other joints than the task.
        """
        self.arena = TaskBatch(task, stepper)
        self._rngs = [np.random.default_rng() for _ in range(stepper.size)]
        self._returns = np.zeros(stepper.size)
        self._ended: list[RunningEpisode] = []
        self._seen = np.zeros((stepper.size, *task.observation_space.shape), dtype=np.float32)
        self._actions = np.zeros((stepper.size, *task.action_space.shape))
        super().__init__(stepper.size, task.observation_space, task.action_space)

    def reset(self) -> np.ndarray:
        """Begin an episode in every row, with the seeds given since the last reset."""
        for row, seed in enumerate(self._seeds):
            if seed is not None:
                self._rngs[row] = np.random.default_rng(seed)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self.arena.start(self._rngs)
        self._seen = self.arena.observe()
        return self._seen.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (B, a) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, object]]]:
        """Act for one control period; finished rows restart, and their observation is that of the new episode."""
        verdict, truncated = self.arena.step(self._actions)
        self._returns += verdict.reward
        lost = self.arena.lost
        observations = np.where(lost[:, None], self._seen, self.arena.observe())
        infos: list[dict[str, object]] = [{} for _ in range(self.num_envs)]
        done = verdict.terminated | truncated
        rows = np.flatnonzero(done)
        if len(rows):
            for row in rows:
                total, length = float(self._returns[row]), int(self.arena.elapsed[row])
                infos[row] = {
                    "terminal_observation": observations[row].copy(),
                    "TimeLimit.truncated": bool(truncated[row]),
                    "is_success": bool(self.arena.succeeded[row]),
                    "episode": {"r": total, "l": length},
                }
                self._ended.append(RunningEpisode(total, length, bool(self.arena.succeeded[row]), bool(lost[row])))
            self._returns[rows] = 0.0
            self.arena.start([self._rngs[row] for row in rows], rows)
            observations[rows] = self.arena.observe()[rows]
        self._seen = observations.copy()
        return observations, verdict.reward.astype(np.float32), done, infos

    def take_episodes(self) -> list[RunningEpisode]:
        """Return the episodes that ended since the last call, unfinished ones excluded."""
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """Nothing to close: the simulations are plain memory."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[object]:
        """Return an attribute once for each row; all rows share it."""
        value = None if attr_name == "render_mode" else getattr(self.arena.task, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: Indices = None) -> None:
        """Refuse: a task is immutable."""
        raise AttributeError(f"'{attr_name}' cannot be set; a task does not change. Build another environment.")

    def env_method(
        self, method_name: str, *method_args: object, indices: Indices = None, **method_kwargs: object
    ) -> list[object]:
        """Refuse: there are no single environments to call."""
        raise AttributeError(f"The rows of ArmVecEnv have no method '{method_name}'.")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """Return False once for each row."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return None once for each row: there are no images."""
        return [None] * self.num_envs
