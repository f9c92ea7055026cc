"""One rollout of a policy on an arm: readings, commands, rewards and successes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import DONE, REWARD, SUCCESS
from nas_data.envs.base import StepResult, Task
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.policies.evaluate import Returns
from nas_data.policies.policy import Policy
from nas_data.policies.rollouts.robot_stepper import ArmAttempt, RobotStepper


@dataclass(frozen=True)
class RolloutScore:
    """Rewards and successes of an episode of T steps."""

    # reward of each step, shape (T,), float32 as in the file, so that returns survive a resume unchanged
    rewards: np.ndarray
    successes: np.ndarray  # whether the goal was reached by each step, shape (T,)

    @classmethod
    def of(cls, verdicts: Sequence[StepResult]) -> "RolloutScore":
        """Collect the verdicts of an episode."""
        rewards = np.array([verdict.reward[0] for verdict in verdicts], dtype=np.float32)
        return cls(rewards, np.array([bool(verdict.success[0]) for verdict in verdicts]))

    def columns(self) -> dict[str, np.ndarray]:
        """Return the dataset columns, shape (T, 1) each; `done` is true at the last step only."""
        done = np.arange(len(self.rewards)) == len(self.rewards) - 1
        return {REWARD: self.rewards[:, None], DONE: done[:, None], SUCCESS: self.successes[:, None]}

    def score(self) -> Returns:
        """Return the score of the episode."""
        return Returns(
            returns=np.array([self.rewards.sum(dtype=float)]),
            successes=np.array([self.successes.any()]),
            lengths=np.array([len(self.rewards)]),
            diverged=np.array([False]),
        )


def read_judgements(dataset: Dataset) -> Iterator[RolloutScore]:
    """Yield the rewards and successes of each rollout in a dataset; a rollout may have several resets."""
    ends = np.flatnonzero(dataset.columns[DONE][:, 0]) + 1
    for first, last in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=False):
        rewards, successes = (dataset.columns[key][first:last, 0] for key in (REWARD, SUCCESS))
        yield RolloutScore(rewards, successes.astype(bool))


def roll_out_on_arm(
    task: Task, stepper: RobotStepper, policy: Policy, seed: int
) -> tuple[list[ArmAttempt], RolloutScore]:
    """Play one episode with a policy's mean actions.

    Args:
        task: The task.
        stepper: The arm or arms.
        policy: The policy.
        seed: Seed of the start.

    Returns:
        Readings and commands from reset to reset, T steps in all, and their rewards and successes.

    Raises:
        ArmError: an arm failed.
    """
    arena = TaskBatch(task, stepper)
    arena.start([np.random.default_rng(seed)])
    verdicts, over = list[StepResult](), False
    while not over:
        verdict, truncated = arena.step(policy.act(arena.observe()))
        verdicts.append(verdict)
        over = bool((verdict.terminated | truncated)[0])
    return stepper.take_bouts(), RolloutScore.of(verdicts)
