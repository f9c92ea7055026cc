"""Evaluation of policies: return and success over the same episodes for every policy, and their table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.envs.base import Task, find_task_file
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import CheckpointError, OptionError
from nas_data.log import warn
from nas_data.policies.policy import Policy, PolicyScore, find_policies, load_policy
from nas_data.simulators.base import Stepper
from nas_data.text_table import format_table
from nas_data.typed_json import as_object

HEADERS = ("policy", "seeds", "return: median", "min … max", "mean ± sd", "success: median", "min … max")

SEED = 20180629  # seed of evaluation starts and goals; training seeds are hashed, so the episodes differ

Controller = Callable[[np.ndarray], np.ndarray]
"""From observations (B, o) to actions (B, a)."""


@dataclass(frozen=True)
class Returns:
    """Results of E episodes."""

    returns: np.ndarray  # sum of rewards of each episode, shape (E,)
    successes: np.ndarray  # whether each reached its goal, shape (E,)
    lengths: np.ndarray  # control steps of each, shape (E,)
    diverged: np.ndarray  # whether each ended because the simulation diverged, shape (E,)

    @property
    def mean_return(self) -> float:
        """Mean return over episodes."""
        return float(self.returns.mean())

    @property
    def success_rate(self) -> float:
        """Share of episodes that reached the goal."""
        return float(self.successes.mean())

    @property
    def mean_length(self) -> float:
        """Mean number of control steps."""
        return float(self.lengths.mean())

    def summary(self) -> PolicyScore:
        """Return the score over all episodes."""
        median, diverged = float(np.median(self.returns)), int(self.diverged.sum())
        return PolicyScore(self.mean_return, median, self.success_rate, self.mean_length, diverged, len(self.returns))

    def describe(self) -> dict[str, object]:
        """Return the score for JSON."""
        return as_object(self.summary())


def roll_out(task: Task, stepper: Stepper, begin: Callable[[TaskBatch], Controller], seed: int = SEED) -> Returns:
    """Run one episode in each of B simulations.

    Args:
        task: The task.
        stepper: B simulations; the start of episode i is drawn with the seed `seed + i`.
        begin: Called after the episodes have begun; returns the function that acts.
        seed: Seed of starts and goals.
    """
    arena = TaskBatch(task, stepper)
    arena.start([np.random.default_rng(seed + row) for row in range(arena.size)])
    act = begin(arena)
    returns, lengths = np.zeros(arena.size), np.zeros(arena.size, dtype=int)
    successes, diverged = np.zeros(arena.size, dtype=bool), np.zeros(arena.size, dtype=bool)
    running = np.ones(arena.size, dtype=bool)
    while running.any():
        verdict, truncated = arena.step(act(arena.observe()))
        returns += np.where(running & ~arena.lost, verdict.reward, 0.0)
        lengths += running
        successes |= running & verdict.success
        diverged |= running & arena.lost
        running &= ~(verdict.terminated | truncated)
        if arena.lost.any() and running.any():  # finished rows are simulated along with the others
            rows = np.flatnonzero(arena.lost)
            arena.start([np.random.default_rng(seed + row) for row in rows], rows)
    due = task.horizon - lengths[diverged] + 1
    returns[diverged] += due * min(arena.least, 0.0)  # as `TaskBatch` does, by the least reward of all episodes
    return Returns(returns=returns, successes=successes, lengths=lengths, diverged=diverged)


def act_with_zeros(arena: TaskBatch) -> Controller:
    """Act with zeros, the middle of every range."""
    actions = np.zeros((arena.size, *arena.task.action_space.shape))
    return lambda _: actions


def hold_start(arena: TaskBatch) -> Controller:
    """Hold the arm in the pose in which the episode began."""
    actions = arena.task.hold(arena.stepper)
    return lambda _: actions


def act_randomly(arena: TaskBatch) -> Controller:
    """Draw every action uniformly."""
    rng = np.random.default_rng(SEED)
    shape = (arena.size, *arena.task.action_space.shape)
    return lambda _: rng.uniform(-1.0, 1.0, shape)


BASELINES: Mapping[str, Callable[[TaskBatch], Controller]] = {
    "zero action": act_with_zeros,
    "hold the start": hold_start,
    "random actions": act_randomly,
}


def score_policy(policy: Policy, plant: DynamicsSpec, episodes: int, stepper: Stepper | None = None) -> Returns:
    """Roll out a policy's mean actions on a plant, with frozen observation statistics.

    Args:
        policy: Trained policy.
        plant: Dynamics of the evaluation.
        episodes: Number of episodes.
        stepper: Batch of `episodes` simulations, instead of the plant's own.

    Raises:
        CheckpointError: the policy was trained for another environment.
        OptionError: no episodes are asked for.
    """
    if episodes < 1:
        raise OptionError(f"--episodes is {episodes}; it must be 1 or more.")
    check_fits(policy, plant.environment)
    return roll_out(plant.task, stepper or plant.stepper(episodes), lambda _: policy.act)


def check_fits(policy: Policy, environment: str) -> None:
    """Refuse a policy that was trained for another environment.

    Raises:
        CheckpointError: the policy was trained for another environment.
    """
    if find_task_file(policy.environment) != find_task_file(environment):
        raise CheckpointError(
            f"The policy was trained for {policy.environment}; it cannot be evaluated on {environment}."
        )


def score_baselines(plant: DynamicsSpec, episodes: int, stepper: Stepper | None = None) -> dict[str, Returns]:
    """Score untrained baselines, as a scale for the returns of policies."""
    stepper = stepper or plant.stepper(episodes)
    return {name: roll_out(plant.task, stepper, begin) for name, begin in BASELINES.items()}


@dataclass(frozen=True)
class Group:
    """Policies that differ only in their seed, and their scores on one plant."""

    name: str  # name in tables
    folders: Sequence[Path]  # folders of the policies
    policies: Sequence[Policy]
    scores: Sequence[Returns]  # score of each policy

    @property
    def returns(self) -> np.ndarray:
        """Mean return of each policy, shape (seeds,)."""
        return np.array([score.mean_return for score in self.scores])

    @property
    def success_rates(self) -> np.ndarray:
        """Success rate of each policy, shape (seeds,)."""
        return np.array([score.success_rate for score in self.scores])

    def describe(self) -> dict[str, object]:
        """Return the group for JSON: each seed, and the spread over seeds."""
        seeds = [
            {"policy": str(folder), "seed": policy.seed, "frames": policy.frames, **score.describe()}
            for folder, policy, score in zip(self.folders, self.policies, self.scores, strict=True)
        ]
        return {
            "name": self.name,
            "seeds": seeds,
            "return": summarise_spread(self.returns),
            "success_rate": summarise_spread(self.success_rates),
        }


def score_group(path: Path, plant: DynamicsSpec, episodes: int, stepper: Stepper) -> Group:
    """Score the policy or policies at a path."""
    folders = find_policies(path)
    policies = [load_policy(folder) for folder in folders]
    scores = [score_policy(policy, plant, episodes, stepper) for policy in policies]
    return Group(name=str(path), folders=folders, policies=policies, scores=scores)


def warn_of_unequal_training(groups: Sequence[Group]) -> None:
    """Warn of groups in which seeds were trained for different numbers of frames, as after an interruption."""
    for group in groups:
        if len({policy.frames for policy in group.policies}) > 1:
            trained = ", ".join(f"seed {policy.seed} has {policy.frames:,} frames" for policy in group.policies)
            warn([f"{group.name} pools policies of different training ({trained}); train all to the same --frames"])


def summarise_spread(values: np.ndarray) -> dict[str, float]:
    """Return median, extremes, mean and sample standard deviation (0 for one value) of values over seeds."""
    return {
        "median": float(np.median(values)),
        "min": float(values.min()),
        "max": float(values.max()),
        "mean": float(values.mean()),
        "sd": float(values.std(ddof=1)) if len(values) > 1 else 0.0,
    }


def format_group_row(group: Group) -> tuple[str, ...]:
    """Return one table row for policies that differ only in their seed."""
    returns, success = summarise_spread(group.returns), summarise_spread(group.success_rates)
    return (
        group.name,
        str(len(group.scores)),
        f"{returns['median']:.2f}",
        f"{returns['min']:.2f} … {returns['max']:.2f}",
        f"{returns['mean']:.2f} ± {returns['sd']:.2f}",
        f"{success['median']:.0%}",
        f"{success['min']:.0%} … {success['max']:.0%}",
    )


def format_policy_table(groups: Sequence[Group], baselines: Mapping[str, Returns]) -> str:
    """Return groups, then untrained baselines, as aligned text."""
    rows = [format_group_row(group) for group in groups]
    rows += [
        (name, "", f"{score.mean_return:.2f}", "", "", f"{score.success_rate:.0%}", "")
        for name, score in baselines.items()
    ]
    return format_table(HEADERS, rows)
