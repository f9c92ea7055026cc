"""Rollouts of policies on an arm: the plan of starts, one rollout, and its score."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import DONE, REWARD, SUCCESS
from nas_data.envs.base import StepResult, Task
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.policies.evaluate import SEED, Group, Returns, check_fits
from nas_data.policies.policy import WEIGHTS, Policy, find_policies, load_policy
from nas_data.policies.rollouts.robot_stepper import ArmAttempt, RobotStepper


@dataclass(frozen=True)
class RolloutScore:
    """Rewards and successes of an episode of T steps."""

    # reward of each step, shape (T,), float32 as in the file, so that returns survive a resume unchanged
    rewards: np.ndarray
    successes: np.ndarray  # whether the goal was reached by each step, shape (T,)

    @classmethod
    def of(cls, verdicts: Sequence[StepResult]) -> "RolloutScore":
        """Collect the step results of an episode."""
        rewards = np.array([verdict.reward[0] for verdict in verdicts], dtype=np.float32)
        return cls(rewards, np.array([bool(verdict.success[0]) for verdict in verdicts]))

    def columns(self) -> dict[str, np.ndarray]:
        """Return the dataset columns, shape (T, 1) each; `done` is true at the last step only."""
        done = np.arange(len(self.rewards)) == len(self.rewards) - 1
        return {REWARD: self.rewards[:, None], DONE: done[:, None], SUCCESS: self.successes[:, None]}

    def to_returns(self) -> Returns:
        """Return the score of the episode."""
        return Returns(
            returns=np.array([self.rewards.sum(dtype=float)]),
            successes=np.array([self.successes.any()]),
            lengths=np.array([len(self.rewards)]),
            diverged=np.array([False]),
        )


def read_rollout_scores(dataset: Dataset) -> Iterator[RolloutScore]:
    """Yield the rewards and successes of each rollout in a dataset; a rollout may have several resets."""
    ends = np.flatnonzero(dataset.columns[DONE][:, 0]) + 1
    for first, last in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=False):
        rewards, successes = (dataset.columns[key][first:last, 0] for key in (REWARD, SUCCESS))
        yield RolloutScore(rewards, successes.astype(bool))


def roll_out_on_arm(
    task: Task, stepper: RobotStepper, policy: Policy, seed: int
) -> tuple[list[ArmAttempt], RolloutScore]:
    """Play one episode with a policy's mean actions.

    Returns:
        Readings and commands from reset to reset, T steps in total, and their score.

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
    return stepper.pop_attempts(), RolloutScore.of(verdicts)


@dataclass(frozen=True)
class EvaluationPlan:
    """Plan in which every policy plays the same starts, policy by policy."""

    paths: tuple[Path, ...]  # folders that the user gave, each with one policy or one per seed
    folders: tuple[tuple[Path, ...], ...]  # folders of the policies, for each path
    policies: dict[Path, Policy]  # policies by folder
    episodes: int  # number of episodes of each policy

    @classmethod
    def of(cls, paths: Sequence[Path], environment: str, episodes: int) -> "EvaluationPlan":
        """Read policies.

        Raises:
            CheckpointError: there are no policies, or they were trained for another environment.
        """
        folders = tuple(tuple(find_policies(path)) for path in paths)
        policies = {folder: load_policy(folder) for found in folders for folder in found}
        for policy in policies.values():
            check_fits(policy, environment)
        return cls(tuple(paths), folders, policies, episodes)

    def turns(self) -> list[tuple[Policy, int]]:
        """Return the policy and the start seed of each episode; seeds are the same as in simulation."""
        listed = [folder for found in self.folders for folder in found]
        return [(self.policies[folder], SEED + number) for folder in listed for number in range(self.episodes)]

    def hash_weights(self) -> list[str]:
        """Return the SHA-256 of each policy's weights, in playing order."""
        files = [folder / WEIGHTS for found in self.folders for folder in found]
        return [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]

    def groups(self, scores: Sequence[Returns]) -> list[Group]:
        """Group the scores of all episodes by the folders that the user gave."""
        left = iter(scores)
        groups = []
        for path, found in zip(self.paths, self.folders, strict=True):
            of_each = [concatenate_scores([next(left) for _ in range(self.episodes)]) for _ in found]
            groups.append(Group(str(path), found, [self.policies[folder] for folder in found], of_each))
        return groups


def concatenate_scores(scores: Sequence[Returns]) -> Returns:
    """Concatenate the scores of episodes."""
    return Returns(*(np.concatenate([getattr(score, part.name) for score in scores]) for part in fields(Returns)))
