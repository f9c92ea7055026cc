"""A task on a batch of simulations or on a robot: bookkeeping of episodes."""

from collections.abc import Sequence

import gymnasium
import numpy as np

from nas_data.envs.base import StepResult, Task
from nas_data.errors import JointMismatch, OptionError, SimulationDiverged
from nas_data.simulators.base import RandomizedStepper, Stepper


class TaskBatch:
    """A task on B simulations, with the state of each episode.

    Each row has its own random generator, so its episodes depend neither on B nor on other rows.

    A diverged simulation ends its episode without success. For this step and each remaining step of the episode it gets
    the smallest reward of any row so far, at most zero. Without this penalty an early end would pay off in tasks with
    negative rewards.

    Attributes:
        lost: Which simulations diverged in the last step, shape (B,).
        succeeded: Which episodes have reached their goal in any step so far, shape (B,).
        least: Smallest reward of any row so far; infinite before the first.
    """

    def __init__(self, task: Task, stepper: Stepper) -> None:
        """Bring a task and simulations together.

        Raises:
            JointMismatch: the simulations have other joints than the task.
        """
        if tuple(stepper.joints) != task.joints:
            raise JointMismatch(
                f"The task moves the joints {', '.join(task.joints)}; the simulation has {', '.join(stepper.joints)}."
            )
        self.task = task
        self.stepper = stepper
        self.size = stepper.size
        self.elapsed = np.zeros(self.size, dtype=int)
        self.lost = np.zeros(self.size, dtype=bool)
        self.succeeded = np.zeros(self.size, dtype=bool)
        self.least = np.inf
        self._goals: np.ndarray | None = None

    @property
    def goals(self) -> np.ndarray:
        """Goals and memory of the episodes, shape (B, k)."""
        if self._goals is None:
            raise gymnasium.error.ResetNeeded("Call reset() before step().")
        return self._goals

    def start(self, rngs: Sequence[np.random.Generator], rows: np.ndarray | None = None) -> None:
        """Begin new episodes.

        Args:
            rngs: One generator per row that starts.
            rows: Rows that start, shape (rows,); all if None.
        """
        starts = [self.task.start(rng) for rng in rngs]
        goals = np.stack([start.goal for start in starts])
        if self._goals is None:
            self._goals = np.zeros((self.size, goals.shape[1]))
        if rows is None:
            self.least = np.inf
        chosen = slice(None) if rows is None else rows
        self._goals[chosen] = goals
        self.elapsed[chosen], self.succeeded[chosen] = 0, False
        if isinstance(self.stepper, RandomizedStepper):
            self.stepper.redraw(rngs, rows)
        self.stepper.reset(np.stack([np.concatenate([start.state, start.objects]) for start in starts]), rows)

    def observe(self) -> np.ndarray:
        """Return the observations (B, o), float32."""
        return self.task.observe(self.stepper, self.goals)

    def step(self, actions: np.ndarray) -> tuple[StepResult, np.ndarray]:
        """Act for one control period.

        Args:
            actions: Shape (B, a); clipped to the action space.

        Returns:
            The task's verdict, and which episodes reached the horizon without being terminated, shape (B,).

        Raises:
            OptionError: an action is not finite, or the actions have another shape.
            SimulationDiverged: every simulation diverged in the first step.
        """
        goals = self.goals
        self._check(actions)
        actions = np.clip(actions, self.task.action_space.low, self.task.action_space.high)
        states = self.stepper.step(self.task.command(actions))
        self.lost = ~np.isfinite(states).all(axis=1)
        self.elapsed += 1
        self._goals = self.task.follow(self.stepper, goals, self.elapsed)
        verdict = self.task.judge(self.stepper, self._goals, actions)
        self.least = min(self.least, float(verdict.reward[~self.lost].min(initial=np.inf)))
        if self.lost.any():
            verdict = self._terminate_lost_rows(verdict)
        self.succeeded |= verdict.success
        return verdict, (self.elapsed >= self.task.horizon) & ~verdict.terminated

    def _check(self, actions: np.ndarray) -> None:
        """Refuse invalid actions; clipping an infinite one would hide a policy's error."""
        wanted = (self.size, *self.task.action_space.shape)
        if np.shape(actions) != wanted:
            raise OptionError(f"The actions have the shape {np.shape(actions)[1:]}; {wanted[1:]} is needed.")
        wrong = np.argwhere(~np.isfinite(actions))
        if len(wrong):
            row, place = (int(index) for index in wrong[0])
            raise OptionError(f"Component {place} of the action is {actions[row, place]}; finite numbers are needed.")

    def _terminate_lost_rows(self, verdict: StepResult) -> StepResult:
        """Return the result with diverged rows terminated without success."""
        if not np.isfinite(self.least):
            raise SimulationDiverged(
                f"The simulation of {self.task.robot} diverged in its first step; its model or checkpoint is not "
                "stable for these commands."
            )
        due = self.task.horizon - self.elapsed + 1  # control steps, including this one
        return StepResult(
            reward=np.where(self.lost, due * min(self.least, 0.0), verdict.reward),
            terminated=verdict.terminated | self.lost,
            success=verdict.success & ~self.lost,
        )
