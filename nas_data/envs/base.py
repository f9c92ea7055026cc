"""What an environment is about: a task, which is told states and asked for commands."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from gymnasium import spaces

from nas_data import registry
from nas_data.effects.base import Effect, parse
from nas_data.environment_ids import environment_name
from nas_data.errors import UnknownName
from nas_data.simulators.base import Simulator, Stepper

if TYPE_CHECKING:
    from nas_data.gap.named import Named
    from nas_data.robots.base import Robot

SOURCE = "source"
Edit = Callable[[mujoco.MjSpec], None]


@dataclass(frozen=True)
class Start:
    """How one episode begins.

    Attributes:
        state: Joint positions [rad] then velocities [rad/s], shape (2n,).
        goal: What the episode is about and what the task remembers of it, in the task's own units, shape (k,).
        objects: Positions then velocities of the objects in the scene, shape (m,); empty for their reference.
    """

    state: np.ndarray
    goal: np.ndarray
    objects: np.ndarray = field(default_factory=lambda: np.empty(0))


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
        edits: What a dynamics changes in the model beyond effects, before they are added.
    """

    robot: str
    joints: tuple[str, ...]
    period: float
    horizon: int
    observation_space: spaces.Box
    action_space: spaces.Box
    dynamics: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    edits: Mapping[str, Edit] = field(default_factory=dict)

    def start(self, rng: np.random.Generator) -> Start:
        """Draw how an episode begins."""
        raise NotImplementedError(f"{type(self).__name__} has no start()")

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return commands (B, n), positions [rad] or torques [N·m], for actions (B, a)."""
        raise NotImplementedError(f"{type(self).__name__} has no command()")

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations (B, o), float32 and within their space, of the present states and goals (B, k)."""
        raise NotImplementedError(f"{type(self).__name__} has no observe()")

    def follow(self, stepper: Stepper, goals: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
        """Do what happens by itself after a control step, and remember what the step brought; here nothing.

        Args:
            stepper: The simulations, to be guided or reset where the scene asks for it.
            goals: What episodes are about and what is remembered of them, shape (B, k).
            elapsed: Control steps since each episode's start, shape (B,).

        Returns:
            The goals from now on, shape (B, k).
        """
        return goals

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

    def simulator(self, dynamics: str = SOURCE, named: "Named | None" = None, engine: str = "mujoco") -> Simulator:
        """Return the simulation of a dynamics, with what a gap report named.

        Raises:
            UnknownName: the task has no such dynamics, or there is no such engine.
            JointMismatch: what was named belongs to another robot.
            ModelFileError: the engine cannot simulate what the dynamics needs.
        """
        robot, effects = self.body(dynamics)
        from nas_data.simulators.engines import load_simulator

        if named is not None:
            robot, effects = named.robot(robot, self.joints), (*effects, *named.effects)
        return load_simulator(robot, self.period, self.joints, effects, engine)

    def body(self, dynamics: str = SOURCE) -> tuple["Robot", tuple[Effect, ...]]:
        """Return the robot as a dynamics changes its model, and the effects that the dynamics adds.

        Raises:
            UnknownName: the task has no such dynamics; lists those it has.
        """
        effects = self.effects(dynamics)
        from nas_data.robots.base import find_robot

        robot = find_robot(self.robot)
        if dynamics in self.edits:
            robot = replace(robot, edit=in_turn(robot.edit, self.edits[dynamics]))
        return robot, effects


@dataclass(frozen=True)
class InTurn:
    """An edit of a model that does one after the other.

    Attributes:
        first: May be none.
        second: Comes after it.
    """

    first: Edit | None
    second: Edit

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Edit a model."""
        if self.first is not None:
            self.first(spec)
        self.second(spec)


def in_turn(first: Edit | None, second: Edit) -> Edit:
    """Return an edit of a model that does one after the other."""
    return InTurn(first, second)


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
