"""PyBullet as a simulator: the same models and servos on another physics engine."""

import copy
from collections.abc import Callable, Iterable, Sequence
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.hook import StepForces
from nas_data.errors import ModelFileError, SimulationDiverged
from nas_data.mjcf.actuator_lookup import goal_joints
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.bullet_world import BulletWorld
from nas_data.simulators.compiled import Compiled
from nas_data.simulators.layout import INTEGRATION, RestStates
from nas_data.simulators.projection import Projection

BOUND = 1e4  # [rad or rad/s] beyond which a simulation has diverged


class BulletSimulator:
    """A robot model with effects, stepped at a control period by PyBullet.

    Bodies, joint limits, Coulomb friction and contacts are PyBullet's. Equality constraints (joints that follow others,
    loops, joints that are held) are met by a projection after each physics step. The torques of servos, springs and
    dampers follow the model's own definition, evaluated at PyBullet's state, so that every effect that a model can
    express acts here too.

    Attributes:
        joints: Measured and commanded joints.
        period: Control period [s].
        substeps: Physics steps per control period.
        model: Compiled MuJoCo model from which the world is made.
        layout: Where the joints are in it.
    """

    engine = "bullet"

    def __init__(
        self, robot: Robot, period: float, joints: Sequence[str] | None = None, effects: Iterable[Effect] = ()
    ) -> None:
        """Compile the model and load it into a world; arguments and errors as for `MujocoSimulator`.

        Raises:
            MissingPackage: PyBullet is not installed.
        """
        self.compiled = Compiled.of(robot, period, joints, effects)
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
        return self._roll(states, np.asarray(commands)[:, None])[:, 0]

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes in open loop; see `Simulator.rollout`."""
        self.compiled.check(initial, commands)
        return self._roll(initial, commands)

    def rollout_settled(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Do as `rollout`: the worlds of this engine have no play, springs or delays."""
        return self.rollout(initial, commands)

    def stepper(self, size: int) -> "BulletStepper":
        """Return a batch of simulations for closed loops, each in a world of its own."""
        return BulletStepper(self, size)

    def describe(self) -> dict[str, object]:
        """Return the source for provenance."""
        return self.compiled.describe(self.engine, metadata.version("pybullet"))

    def close(self) -> None:
        """Close the simulator's world; garbage collection does so, too."""
        self._arm.world.close()

    def _roll(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Roll out from rest states (B, 2n or 2n + m) under commands (B, T, n), one simulation after the other."""
        states = np.asarray(initial, float)
        full = self.rest(states)
        controls = self.layout.controls(np.asarray(commands, float), states[:, None])
        result = np.empty((*commands.shape[:2], states.shape[1]))
        joints = 2 * len(self.joints)
        for row in range(len(result)):
            self._arm.start(full[row])
            for step in range(commands.shape[1]):
                result[row, step, :joints] = self._arm.step(controls[row, step])
                if states.shape[1] > joints:
                    result[row, step, joints:] = self._arm.objects()
        return result


class BulletArm:
    """One arm in one world, with the memory of its servos."""

    def __init__(self, simulator: BulletSimulator) -> None:
        """Load the simulator's model into a world of its own."""
        self.model, self.layout = simulator.model, simulator.layout
        self.substeps = simulator.substeps
        self.world = BulletWorld(self.model)
        # MuJoCo evaluates the servos: their torques at PyBullet's state, and what they remember (delay, setpoint)
        self.servos = mujoco.MjData(self.model)
        self.servo_model = without_constraints(self.model)
        goals = goal_joints(self.model)
        self.goal_qpos, self.goal_dof = self.model.jnt_qposadr[goals], self.model.jnt_dofadr[goals]
        forces = StepForces(
            force=self.servos.actuator_force[None],
            bias=self.servos.qfrc_bias[None],
            released=np.zeros(1, bool),
        )
        self.hooks = [hook(forces) for hook in simulator.hooks]
        self.projection = Projection.of(self.model)

    def start(self, state: np.ndarray) -> None:
        """Start anew from a full MuJoCo state (size of INTEGRATION)."""
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
            torques[self.goal_dof] = 0.0  # MuJoCo's copy moves them
            self.world.step(torques)
            if self.projection is not None:
                self.world.set(*self.projection(*self.world.read(), self.mass()))
        return self.measure()

    def mass(self) -> np.ndarray:
        """Return the mass matrix at the start of the physics step, shape (nv, nv)."""
        full = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.servo_model, self.servos, full)
        return full

    def measure(self) -> np.ndarray:
        """Return the measured state, positions [rad] then velocities [rad/s], shape (2n,).

        Raises:
            SimulationDiverged: a joint left all bounds.
        """
        qpos, qvel = self.world.read()
        state = self.layout.measure(qpos, qvel)
        if not (np.abs(state) < BOUND).all():
            raise SimulationDiverged(
                f"The model diverges in PyBullet ({state.max():g}); shorten its timestep, soften its gains or check "
                "its inertias."
            )
        return state

    def objects(self) -> np.ndarray:
        """Return positions then velocities of what moves beside the joints, shape (m,)."""
        return self.layout.objects.measure(*self.world.read())

    def shift(self, change: np.ndarray) -> None:
        """Move the servos' joints by (2n,), and those that follow them; play and other hidden joints keep theirs."""
        n, followers = len(self.layout.joints), self.layout.followers
        qpos, qvel = self.world.read()
        slack = None if followers is None else followers.slack(qpos[None], qvel[None])
        qpos[self.layout.qpos] += change[:n]
        qvel[self.layout.dof] += change[n:]
        if followers is not None and slack is not None:
            followers.place_with(slack, qpos[None], qvel[None])
        self.world.set(qpos, qvel)

    def site(self, index: int) -> np.ndarray:
        """Return where a site is in the world [m], shape (3,)."""
        self.servos.qpos[:] = self.world.read()[0]
        mujoco.mj_kinematics(self.model, self.servos)
        return self.servos.site_xpos[index].copy()


def without_constraints(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model in which limits, friction and contacts, which are PyBullet's to solve, cost nothing."""
    copied = copy.copy(model)
    copied.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return copied


class BulletStepper:
    """A batch of simulations of one model in a closed loop; implements `Stepper`."""

    def __init__(self, simulator: BulletSimulator, size: int) -> None:
        """Create the batch, every simulation at rest at zero."""
        self.simulator = simulator
        self.joints = simulator.joints
        self.size = size
        self._arms = [BulletArm(simulator) for _ in range(size)]
        self._guided = np.tile(simulator.layout.reference, (size, 1))
        self.reset(np.zeros((size, 2 * len(self.joints))))

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (B, 2n); NaN where a simulation diverged."""
        return np.stack([self._unless_lost(arm.measure) for arm in self._arms])

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Start simulations anew; see `Stepper.reset`."""
        states = np.asarray(states, float)
        full, chosen = self.simulator.rest(states), np.arange(self.size) if rows is None else rows
        for state, row in zip(full, chosen, strict=True):
            self._arms[int(row)].start(state)
        layout = self.simulator.layout
        held = np.where(layout.inputs.positional, states[:, : len(self.joints)], 0.0)
        self._guided[chosen] = layout.controls(held, states)

    @property
    def objects(self) -> np.ndarray:
        """What moves beside the joints, shape (B, m); see `Stepper.objects`."""
        return np.stack([arm.objects() for arm in self._arms])

    def guide(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.guide`."""
        objects = self.simulator.layout.objects
        self._guided[np.ix_(rows, objects.control)] = objects.inputs.of_commands(targets)

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        controls = self._guided
        layout = self.simulator.layout
        controls[:, layout.control] = layout.inputs.of_commands(commands)
        return np.stack([self._unless_lost(arm.step, row) for arm, row in zip(self._arms, controls, strict=True)])

    def set_states(self, states: np.ndarray) -> None:
        """Move the servos so that the measured state becomes `states`; play and other hidden joints keep theirs."""
        for arm, change in zip(self._arms, states - self.states, strict=True):
            if np.isfinite(change).all():
                arm.shift(change)

    def _unless_lost(self, tell: Callable[..., np.ndarray], *controls: np.ndarray) -> np.ndarray:
        """Return a state (2n,); NaN where this simulation diverged, so that the others of the batch go on."""
        try:
            return tell(*controls)
        except SimulationDiverged:
            return np.full(2 * len(self.joints), np.nan)

    def site_positions(self, name: str) -> np.ndarray:
        """Return where a site is in the world [m], shape (B, 3).

        Raises:
            ModelFileError: the model has no such site.
        """
        site = mujoco.mj_name2id(self.simulator.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0:
            raise ModelFileError(f"{self.simulator.robot.mjcf} has no site '{name}'; add <site name='{name}'/>.")
        return np.stack([arm.site(site) for arm in self._arms])
