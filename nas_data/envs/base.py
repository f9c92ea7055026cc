"""What an environment is about: a task, which is told states and asked for commands."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from gymnasium import spaces

from nas_data import registry
from nas_data.effects.base import Effect, parse
from nas_data.errors import UnknownName
from nas_data.simulators.base import Simulator, Stepper

if TYPE_CHECKING:
    from nas_data.gap.named import Named

SOURCE = "source"


@dataclass(frozen=True)
class Start:
    """How one episode begins.

    Attributes:
        state: Joint positions [rad] then velocities [rad/s], shape (2n,).
        goal: What the episode is about, in the task's own units, shape (k,).
    """

    state: np.ndarray
    goal: np.ndarray


@dataclass(frozen=True)
class Verdict:
    """What a task says of one control step of B simulations.

    Attributes:
        reward: Shape (B,), float64.
        terminated: Whether the episode is over because of what happened, shape (B,).
        success: Whether the goal is reached, shape (B,).
    """

    reward: np.ndarray
    terminated: np.ndarray
    success: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Task:
    """Base of the tasks; the file `envs/a_b.py` holds one as `TASK`, which becomes the environment `nas/AB-v0`.

    A task is told states and asked for commands; it never knows whether physics, a network or a robot moves the arm.

    Attributes:
        robot: Name of the robot.
        joints: Joints in the order of states and commands.
        period: Control period [s].
        horizon: Control steps after which an episode is cut off.
        observation_space: Bounded observations, float32.
        action_space: Normalised actions in [-1, 1], float32.
        dynamics: What each name of `dynamics=` adds to the source, as `effects.base.parse` reads it.
    """

    robot: str
    joints: tuple[str, ...]
    period: float
    horizon: int
    observation_space: spaces.Box
    action_space: spaces.Box
    dynamics: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def start(self, rng: np.random.Generator) -> Start:
        """Draw how an episode begins."""
        raise NotImplementedError(f"{type(self).__name__} has no start()")

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return commands (B, n), positions [rad] or torques [N·m], for actions (B, a)."""
        raise NotImplementedError(f"{type(self).__name__} has no command()")

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations (B, o), float32 and within their space, of the present states and goals (B, k)."""
        raise NotImplementedError(f"{type(self).__name__} has no observe()")

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> Verdict:
        """Judge the states that actions (B, a) led to, given goals (B, k)."""
        raise NotImplementedError(f"{type(self).__name__} has no judge()")

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return the actions (B, a) that command the arms to stay where they are."""
        raise NotImplementedError(f"{type(self).__name__} has no hold()")

    def effects(self, dynamics: str) -> tuple[Effect, ...]:
        """Return what a dynamics adds to the source.

        Raises:
            UnknownName: the task has no such dynamics; lists those it has.
        """
        if dynamics not in self.dynamics:
            raise UnknownName("dynamics", dynamics, self.dynamics)
        return tuple(parse(text) for text in self.dynamics[dynamics])

    def simulator(self, dynamics: str = SOURCE, named: "Named | None" = None) -> Simulator:
        """Return the task's robot in MuJoCo with the effects of a dynamics, and with what a gap report named.

        Raises:
            UnknownName: the task has no such dynamics.
            JointMismatch: what was named belongs to another robot.
        """
        effects = self.effects(dynamics)
        from nas_data.robots.base import find_robot
        from nas_data.simulators.mujoco import MujocoSimulator

        robot = find_robot(self.robot)
        if named is not None:
            robot, effects = named.robot(robot, self.joints), (*effects, *named.effects)
        return MujocoSimulator(robot, self.period, self.joints, effects)


def environment_name(task: str) -> str:
    """Return a task's name as an environment: `ergo_reacher` → `ErgoReacher`."""
    return "".join(word.capitalize() for word in task.split("_"))


def environment_id(task: str) -> str:
    """Return a task's name as Gymnasium registers it: `ergo_reacher` → `nas/ErgoReacher-v0`."""
    return f"nas/{environment_name(task)}-v0"


def find_task_file(name: str) -> str:
    """Return the file of a task by its own name or by its environment's: `nas/ErgoReacher-v0` → `ergo_reacher`.

    Raises:
        UnknownName: there is no such environment; lists those there are.
    """
    files = {environment_name(task): task for task in registry.names("envs")}
    wanted = files.get(name.removeprefix("nas/").removesuffix("-v0"), name)
    if wanted not in files.values():
        raise UnknownName("environment", name, files)
    return wanted


def find_task(name: str) -> Task:
    """Return a task by its own name or by its environment's.

    Raises:
        UnknownName: there is no such environment; lists those there are.
    """
    return registry.module("envs", find_task_file(name), "environment").TASK
