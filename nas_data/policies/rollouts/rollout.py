"""One episode of a policy on an arm: what was read and sent, and what the task said after each step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import DONE, REWARD, SUCCESS
from nas_data.envs.base import Task, Verdict
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.policies.evaluate import Returns
from nas_data.policies.policy import Policy
from nas_data.policies.rollouts.robot_stepper import Bout, RobotStepper


@dataclass(frozen=True)
class Judgement:
    """What the task said of an episode of T steps.

    Attributes:
        rewards: Of each step, shape (T,), float32: as they are stored, so that returns are the same after a resume.
        successes: Whether the goal was reached by then, shape (T,).
    """

    rewards: np.ndarray
    successes: np.ndarray

    @classmethod
    def of(cls, verdicts: Sequence[Verdict]) -> "Judgement":
        """Collect the verdicts of an episode."""
        rewards = np.array([verdict.reward[0] for verdict in verdicts], dtype=np.float32)
        return cls(rewards, np.array([bool(verdict.success[0]) for verdict in verdicts]))

    def columns(self) -> dict[str, np.ndarray]:
        """Return what a dataset stores of it, each of shape (T, 1); done is the episode's last step alone."""
        done = np.arange(len(self.rewards)) == len(self.rewards) - 1
        return {REWARD: self.rewards[:, None], DONE: done[:, None], SUCCESS: self.successes[:, None]}

    def score(self) -> Returns:
        """Return how the episode went."""
        return Returns(
            returns=np.array([self.rewards.sum(dtype=float)]),
            successes=np.array([self.successes.any()]),
            lengths=np.array([len(self.rewards)]),
            diverged=np.array([False]),
        )


def judgements(dataset: Dataset) -> Iterator[Judgement]:
    """Yield what the task said of each episode that a dataset of rollouts holds, whatever bouts it consists of."""
    ends = np.flatnonzero(dataset.columns[DONE][:, 0]) + 1
    for first, last in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=False):
        rewards, successes = (dataset.columns[key][first:last, 0] for key in (REWARD, SUCCESS))
        yield Judgement(rewards, successes.astype(bool))


def roll_out_on_arm(task: Task, stepper: RobotStepper, policy: Policy, seed: int) -> tuple[list[Bout], Judgement]:
    """Let a policy's mean actions move an arm for one episode.

    Args:
        task: What is to be done.
        stepper: What moves.
        policy: Who acts.
        seed: Of the start.

    Returns:
        What was read and sent from reset to reset, T steps in all, and what the task said of them.

    Raises:
        ArmError: something is wrong with an arm.
    """
    arena = TaskBatch(task, stepper)
    arena.start([np.random.default_rng(seed)])
    verdicts, over = list[Verdict](), False
    while not over:
        verdict, truncated = arena.step(policy.act(arena.observe()))
        verdicts.append(verdict)
        over = bool((verdict.terminated | truncated)[0])
    return stepper.take_bouts(), Judgement.of(verdicts)
