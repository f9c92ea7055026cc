"""PyBullet as a simulator of the same models and servos."""

import copy
from collections.abc import Callable, Iterable, Sequence
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.hook import StepForces
from nas_data.errors import ModelFileError, SimulationDiverged
from nas_data.mjcf.actuator_lookup import find_goal_joints
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.bullet_world import BulletWorld
from nas_data.simulators.compiled import CompiledRobot
from nas_data.simulators.layout import INTEGRATION
from nas_data.simulators.projection import Projection
from nas_data.simulators.rest_states import RestStates
from nas_data.simulators.yielding_stops import YieldingStops

BOUND = 1e4  # [rad or rad/s] a larger state means divergence


class BulletSimulator:
    """A robot model with effects, stepped at a control period by PyBullet.

    PyBullet simulates bodies, joint limits, Coulomb friction and contacts. Equality constraints (followers, loops,
    locked joints) are met by a projection after each physics step. MuJoCo computes the torques of servos, springs and
    dampers at PyBullet's state, so that effects that a model can express act here, too.

    Attributes:
        joints: Measured and commanded joints.
        period: Control period [s].
        substeps: Physics steps per control period.
        model: Compiled MuJoCo model from which the world is made.
        layout: Indices of the joints in the model.
    """

    engine = "bullet"

    def __init__(
        self, robot: Robot, period: float, joints: Sequence[str] | None = None, effects: Iterable[Effect] = ()
    ) -> None:
        """Compile the model and load it into a world; arguments and errors as for `MujocoSimulator`.

        Raises:
            MissingPackage: PyBullet is not installed.
        """
        self.compiled = CompiledRobot.of(robot, period, joints, effects)
        self.robot, self.effects, self.period = robot, self.compiled.effects, period
        self.model, self.layout = self.compiled.model, self.compiled.layout
        self.substeps, self.hooks = self.compiled.substeps, self.compiled.hooks
        self.joints, self.slides = self.layout.joints, self.compiled.slides
        self.kinds = self.layout.kinds
        self.remembers = self.compiled.remembers
        self.object_feature = self.layout.objects.feature
        self.rest = RestStates(self.model, self.layout, INTEGRATION)
        self._arm = BulletArm(self)

    @classmethod
    def load(
        cls,
        model: str | Path,
        period: float,
        joints: Sequence[str] | None = None,
        effects: Iterable[Effect] = (),
    ) -> "BulletSimulator":
        """Build the simulator from a robot's name or a model file; see `__init__`."""
        return cls(find_robot(model), period, joints, effects)

    def predict(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray | None = None) -> np.ndarray:
        """Simulate independent transitions; see `Simulator.predict`."""
        self.compiled.check(states, commands)
        return self._simulate_rollouts(states, np.asarray(commands)[:, None])[:, 0]

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes in open loop; see `Simulator.rollout`."""
        self.compiled.check(initial, commands)
        return self._simulate_rollouts(initial, commands)

    def rollout_settled(
        self, initial: np.ndarray, commands: np.ndarray, initial_loads: np.ndarray | None = None
    ) -> np.ndarray:
        """Simulate as `rollout`: initial settling is not supported on this engine."""
        return self.rollout(initial, commands)

    def stepper(self, size: int) -> "BulletStepper":
        """Return a batch of simulations for closed loops, each in its own world."""
        return BulletStepper(self, size)

    def describe(self) -> dict[str, object]:
        """Return the description of the source for provenance."""
        return self.compiled.describe(self.engine, metadata.version("pybullet"))

    def close(self) -> None:
        """Close the simulator's world, as garbage collection does."""
        self._arm.world.close()

    def _simulate_rollouts(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Roll out from states (B, 2n or 2n + m) under commands (B, T, n), one simulation after the other."""
        states = np.asarray(initial, float)
        full = self.rest(states)
        controls = self.layout.controls(np.asarray(commands, float), states[:, None])
        result = np.empty((*commands.shape[:2], states.shape[1]))
        joints = 2 * len(self.joints)
        for row in range(len(result)):
            self._arm.reset(full[row])
            for step in range(commands.shape[1]):
                result[row, step, :joints] = self._arm.step(controls[row, step])
                if states.shape[1] > joints:
                    result[row, step, joints:] = self._arm.objects()
        return result


class BulletArm:
    """One arm in one world, with the state of its servos."""

    def __init__(self, simulator: BulletSimulator) -> None:
        """Load the simulator's model into a new world."""
        self.model, self.layout = simulator.model, simulator.layout
        self.substeps = simulator.substeps
        self.name = str(simulator.robot.mjcf)
        self.world = BulletWorld(self.model, self.name)
        # MuJoCo simulates the servos at PyBullet's state: their torques, delays and setpoints
        self.servos = mujoco.MjData(self.model)
        self.servo_model = copy_without_constraints(self.model)
        # sites are computed apart, because `servos` holds the positions of goal joints between steps
        self.kinematics = mujoco.MjData(self.model)
        goals = find_goal_joints(self.model)
        self.goal_qpos, self.goal_dof = self.model.jnt_qposadr[goals], self.model.jnt_dofadr[goals]
        forces = StepForces(
            force=self.servos.actuator_force[None],
            bias=self.servos.qfrc_bias[None],
            velocity=self.servos.qvel[None],
            released=np.zeros(1, bool),
        )
        self.hooks = [hook(forces) for hook in simulator.hooks]
        self.projection = Projection.of(self.model)
        self.stops = YieldingStops(self.model)

    def reset(self, state: np.ndarray) -> None:
        """Reset to a full MuJoCo state (size of INTEGRATION)."""
        mujoco.mj_setState(self.servo_model, self.servos, state, INTEGRATION)
        self.world.set(self.servos.qpos, self.servos.qvel)

    def step(self, controls: np.ndarray) -> np.ndarray:
        """Hold controls (nu,) for one control period and return the measured state (2n,)."""
        self.servos.ctrl[:] = controls
        for _ in range(self.substeps):
            qpos, qvel = self.world.read()
            qpos[self.goal_qpos] = self.servos.qpos[self.goal_qpos]
            qvel[self.goal_dof] = self.servos.qvel[self.goal_dof]
            self.servos.qpos[:], self.servos.qvel[:] = qpos, qvel
            mujoco.mj_step(self.servo_model, self.servos)
            if self.hooks:
                self.world.set_friction(self.model.dof_frictionloss + sum(hook()[0] for hook in self.hooks))
            torques = self.servos.qfrc_actuator + self.servos.qfrc_passive
            if self.stops.joints:
                torques += self.stops.compute_torques(qpos, qvel)
            torques[self.goal_dof] = 0.0  # MuJoCo simulates the goal joints
            self.world.step(torques)
            if self.projection is not None:
                self.world.set(*self.projection(*self.world.read(), self.mass_matrix()))
        return self.measure()

    def mass_matrix(self) -> np.ndarray:
        """Return the mass matrix at the start of the physics step, shape (nv, nv)."""
        full = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.servo_model, self.servos, full)
        return full

    def measure(self) -> np.ndarray:
        """Return the measured state, positions [rad] then velocities [rad/s], shape (2n,).

        Raises:
            SimulationDiverged: a position or velocity exceeds `BOUND`.
        """
        qpos, qvel = self.world.read()
        state = self.layout.measure(qpos, qvel)
        if not (np.abs(state) < BOUND).all():
            raise SimulationDiverged(
                f"{self.name} diverges in PyBullet; shorten its timestep, soften its gains or check its inertias."
            )
        return state

    def objects(self) -> np.ndarray:
        """Return positions then velocities of the objects, shape (m,)."""
        return self.layout.objects.measure(*self.world.read())

    def shift(self, change: np.ndarray) -> None:
        """Change the state of the servos' joints by (2n,), followers included; hidden joints, such as play, stay."""
        n, followers = len(self.layout.joints), self.layout.followers
        qpos, qvel = self.world.read()
        slack = None if followers is None else followers.measure_slack(qpos[None], qvel[None])
        qpos[self.layout.qpos] += change[:n]
        qvel[self.layout.dof] += change[n:]
        if followers is not None and slack is not None:
            followers.place_with_slack(slack, qpos[None], qvel[None])
        self.world.set(qpos, qvel)

    def site_position(self, index: int) -> np.ndarray:
        """Return the world position of a site [m], shape (3,)."""
        self.kinematics.qpos[:] = self.world.read()[0]
        mujoco.mj_kinematics(self.model, self.kinematics)
        return self.kinematics.site_xpos[index].copy()


def copy_without_constraints(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model without limits, friction and contacts, which PyBullet solves."""
    copied = copy.copy(model)
    copied.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return copied


class BulletStepper:
    """A batch of simulations of one model in a closed loop; implements `Stepper`."""

    def __init__(self, simulator: BulletSimulator, size: int) -> None:
        """Create the batch; every simulation is at rest at zero."""
        self.simulator = simulator
        self.joints = simulator.joints
        self.size = size
        self._arms = [BulletArm(simulator) for _ in range(size)]
        self._controls = np.tile(simulator.layout.reference, (size, 1))
        self.reset(np.zeros((size, 2 * len(self.joints))))

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (B, 2n); NaN where a simulation diverged."""
        return np.stack([self._compute_or_nan(arm.measure) for arm in self._arms])

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Reset simulations; see `Stepper.reset`."""
        states = np.asarray(states, float)
        full, chosen = self.simulator.rest(states), np.arange(self.size) if rows is None else rows
        for state, row in zip(full, chosen, strict=True):
            self._arms[int(row)].reset(state)
        layout = self.simulator.layout
        held = np.where(layout.inputs.positional, states[:, : len(self.joints)], 0.0)
        self._controls[chosen] = layout.controls(held, states)

    @property
    def objects(self) -> np.ndarray:
        """States of the objects, shape (B, m); see `Stepper.objects`."""
        return np.stack([arm.objects() for arm in self._arms])

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.command_objects`."""
        objects = self.simulator.layout.objects
        self._controls[np.ix_(rows, objects.control)] = objects.inputs.from_commands(targets)

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        layout = self.simulator.layout
        self._controls[:, layout.control] = layout.inputs.from_commands(commands)
        pairs = zip(self._arms, self._controls, strict=True)
        return np.stack([self._compute_or_nan(arm.step, controls) for arm, controls in pairs])

    def set_states(self, states: np.ndarray) -> None:
        """Move the servos so that the measured state becomes `states`; hidden joints, such as play, keep theirs."""
        for arm, change in zip(self._arms, states - self.states, strict=True):
            if np.isfinite(change).all():
                arm.shift(change)

    def _compute_or_nan(self, compute: Callable[..., np.ndarray], *controls: np.ndarray) -> np.ndarray:
        """Return a state (2n,), or NaN if this simulation diverged, so that the other simulations continue."""
        try:
            return compute(*controls)
        except SimulationDiverged:
            return np.full(2 * len(self.joints), np.nan)

    def site_positions(self, name: str) -> np.ndarray:
        """Return the world position of a site [m], shape (B, 3).

        Raises:
            ModelFileError: the model has no such site.
        """
        site = mujoco.mj_name2id(self.simulator.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0:
            raise ModelFileError(f"{self.simulator.robot.mjcf} has no site '{name}'; add <site name='{name}'/>.")
        return np.stack([arm.site_position(site) for arm in self._arms])
