"""Base class of tasks: a task maps states to observations and rewards, and actions to commands."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from gymnasium import spaces

from nas_data import registry
from nas_data.effects.base import Effect, parse
from nas_data.environment_ids import TARGET_DYNAMICS, make_environment_name
from nas_data.errors import UnknownName
from nas_data.simulators.base import Simulator, Stepper

if TYPE_CHECKING:
    from nas_data.gap.model_correction import ModelCorrection
    from nas_data.robots.base import Edit, Robot

SOURCE = "source"


@dataclass(frozen=True)
class Start:
    """Start of an episode.

    Attributes:
        state: Joint positions [rad] then velocities [rad/s], shape (2n,).
        goal: Goal of the episode and the task's memory of it, in the task's own units, shape (k,).
        objects: Positions then velocities of the scene's objects, shape (m,); empty for their reference state.
    """

    state: np.ndarray
    goal: np.ndarray
    objects: np.ndarray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class StepResult:
    """Outcome of one control step of B simulations.

    Attributes:
        reward: Rewards, shape (B,), float64.
        terminated: Whether the episode ended in a terminal state, shape (B,).
        success: Whether the goal is reached, shape (B,).
    """

    reward: np.ndarray
    terminated: np.ndarray
    success: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Task:
    """Base of the tasks; the file `envs/a_b.py` holds one as `TASK`, which becomes the environment `nas/AB-v0`.

    A task does not depend on what moves the arm: physics, a network or a robot.

    Attributes:
        robot: Name of the robot.
        joints: Joints in the order of states and commands.
        period: Control period [s].
        horizon: Control steps after which an episode is truncated.
        observation_space: Bounded observations, float32.
        action_space: Normalised actions in [-1, 1], float32.
        dynamics: Effects that each value of `dynamics=` adds to the source, as read by `effects.base.parse`.
        edits: Model edits of a dynamics that are applied before its effects.
    """

    robot: str
    joints: tuple[str, ...]
    period: float
    horizon: int
    observation_space: spaces.Box
    action_space: spaces.Box
    dynamics: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    edits: Mapping[str, "Edit"] = field(default_factory=dict)

    def start(self, rng: np.random.Generator) -> Start:
        """Draw the start of an episode."""
        raise NotImplementedError(f"{type(self).__name__} has no start()")

    def command(self, actions: np.ndarray) -> np.ndarray:
        """Return commands (B, n), positions [rad] or torques [N·m], for actions (B, a)."""
        raise NotImplementedError(f"{type(self).__name__} has no command()")

    def observe(self, stepper: Stepper, goals: np.ndarray) -> np.ndarray:
        """Return observations (B, o), float32 and within their space, of the present states and goals (B, k)."""
        raise NotImplementedError(f"{type(self).__name__} has no observe()")

    def follow(self, stepper: Stepper, goals: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
        """Update goals and scene after a control step; by default nothing changes.

        Args:
            stepper: The simulations; scenes may command their objects or reset them.
            goals: Goals and memory of the episodes, shape (B, k).
            elapsed: Control steps since each episode's start, shape (B,).

        Returns:
            The new goals, shape (B, k).
        """
        return goals

    def judge(self, stepper: Stepper, goals: np.ndarray, actions: np.ndarray) -> StepResult:
        """Judge the states that actions (B, a) led to, given goals (B, k)."""
        raise NotImplementedError(f"{type(self).__name__} has no judge()")

    def hold(self, stepper: Stepper) -> np.ndarray:
        """Return the actions (B, a) that hold the arms in their present pose."""
        raise NotImplementedError(f"{type(self).__name__} has no hold()")

    def effects(self, dynamics: str) -> tuple[Effect, ...]:
        """Return the effects that a dynamics adds to the source.

        Raises:
            UnknownName: the task has no such dynamics; lists its dynamics.
        """
        if dynamics not in self.dynamics:
            raise UnknownName("dynamics", dynamics, self.dynamics)
        return tuple(parse(text) for text in self.dynamics[dynamics])

    def find_source(self, dynamics: str) -> str:
        """Return the dynamics of the source for a target: `source`, or the target's own source if it has one.

        Args:
            dynamics: Dynamics of the target, or `TARGET_DYNAMICS`, which not every task has; a source is its own.

        Raises:
            UnknownName: the task has no such dynamics; lists its dynamics.
        """
        if dynamics not in (*self.dynamics, TARGET_DYNAMICS):
            raise UnknownName("dynamics", dynamics, self.dynamics)
        own = dynamics if dynamics.endswith(f"-{SOURCE}") else f"{dynamics}-{SOURCE}"
        return own if own in self.dynamics else SOURCE

    def simulator(
        self, dynamics: str = SOURCE, named: "ModelCorrection | None" = None, engine: str = "mujoco"
    ) -> Simulator:
        """Return the simulator of a dynamics, with the effects and parameters of a gap report.

        Raises:
            UnknownName: the task has no such dynamics, or there is no such engine.
            JointMismatch: the report belongs to another robot.
            ModelFileError: the engine does not support the dynamics.
        """
        robot, effects = self.body(dynamics)
        from nas_data.simulators.engines import load_simulator

        if named is not None:
            robot, effects = named.robot(robot, self.joints), (*effects, *named.effects)
        return load_simulator(robot, self.period, self.joints, effects, engine)

    def body(self, dynamics: str = SOURCE) -> tuple["Robot", tuple[Effect, ...]]:
        """Return the robot with the model edits of a dynamics, and the effects of the dynamics.

        Raises:
            UnknownName: the task has no such dynamics; lists its dynamics.
        """
        effects = self.effects(dynamics)
        from nas_data.robots.base import ConsecutiveEdits, find_robot

        robot = find_robot(self.robot)
        if dynamics in self.edits:
            robot = replace(robot, edit=ConsecutiveEdits(robot.edit, self.edits[dynamics]))
        return robot, effects


def find_task_file(name: str) -> str:
    """Return the file of a task by its own name or by its environment's: `nas/ErgoReacher-v0` → `ergo_reacher`.

    Raises:
        UnknownName: there is no such environment; lists the environments.
    """
    files = {make_environment_name(task): task for task in registry.list_names("envs")}
    wanted = files.get(name.removeprefix("nas/").removesuffix("-v0"), name)
    if wanted not in files.values():
        raise UnknownName("environment", name, files)
    return wanted


def find_task(name: str) -> Task:
    """Return a task by its own name or by its environment's.

    Raises:
        UnknownName: there is no such environment; lists the environments.
    """
    return registry.import_plugin("envs", find_task_file(name), "environment", "TASK").TASK
