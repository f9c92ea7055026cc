"""MuJoCo as a simulator: batched one-step predictions, open-loop rollouts and closed loops of one model."""

import copy
import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np

from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.mjcf.engine_warnings import heard_instability
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.compiled import Compiled
from nas_data.simulators.hooks import HookedBatch, Switching, roll_hooked
from nas_data.simulators.initial_states import InitialLoad, SettledStates
from nas_data.simulators.layout import FULLPHYSICS, INTEGRATION, RestStates, as_slice
from nas_data.simulators.pool import rollout_pool

SERVOS = 30  # actuator group, the engine's last, of what is without power where the torque is off
CHUNK_STATES = 250_000  # numbers of simulated state held at once, 2 MB: with its inputs it stays in the cache


class MujocoSimulator:
    """A robot model with effects, stepped at a control period by MuJoCo.

    Attributes:
        joints: Measured and commanded joints.
        period: Control period [s].
        substeps: Physics steps per control period.
        model: Compiled model.
        layout: Where the joints are in it.
    """

    engine = "mujoco"

    def __init__(
        self,
        robot: Robot,
        period: float,
        joints: Sequence[str] | None = None,
        effects: Iterable[Effect] = (),
        threads: int | None = None,
    ) -> None:
        """Compile the model; see `Compiled.of` for the other arguments and the errors.

        Args:
            robot: Model, joints and constants.
            period: Control period [s].
            joints: Joints to measure and command.
            effects: Effects to add to the model.
            threads: Threads for batched work; all cores where None.
        """
        self.compiled = Compiled.of(robot, period, joints, effects)
        self.robot, self.effects, self.period = robot, self.compiled.effects, period
        self.model, self.layout = self.compiled.model, self.compiled.layout
        self.substeps, self.hooks = self.compiled.substeps, self.compiled.hooks
        self.joints, self.slides = self.layout.joints, self.compiled.slides
        self.kinds = self.layout.kinds
        self.remembers = self.compiled.remembers
        self.object_feature = self.layout.objects.feature
        self.threads = len(os.sched_getaffinity(0)) if threads is None else threads
        self._part = INTEGRATION if self.hooks else FULLPHYSICS
        pooled = self.threads if self.threads > 1 else 0
        self._pool = rollout_pool(pooled)
        self._data = [mujoco.MjData(self.model) for _ in range(max(1, pooled))]

    @cached_property
    def rest(self) -> RestStates:
        """Full states at rest in any posture, nothing loaded."""
        return RestStates(self.model, self.layout, self._part)

    @cached_property
    def settled(self) -> SettledStates:
        """Full states at rest in any posture, settled under the arm's weight."""
        return SettledStates(self.model, self.layout, self._part, self.period, self._data[0])

    @cached_property
    def unpowered(self) -> mujoco.MjModel:
        """The same model with its servos switched off: neither feedback nor back-EMF; friction stays as it is."""
        model = copy.copy(self.model)
        model.actuator_group[model.actuator_ctrlnum > 0] = SERVOS
        model.opt.disableactuator |= 1 << SERVOS
        return model

    @classmethod
    def load(
        cls,
        model: str | Path,
        period: float,
        joints: Sequence[str] | None = None,
        effects: Iterable[Effect] = (),
        threads: int | None = None,
    ) -> "MujocoSimulator":
        """Build the simulator from a robot's name or a model file; see `__init__`."""
        return cls(find_robot(model), period, joints, effects, threads)

    def predict(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray | None = None) -> np.ndarray:
        """Simulate transitions; see `Simulator.predict`."""
        self.compiled.check(states, commands)
        if continues is not None and self.rest.kept:
            return self._in_turn(np.asarray(states, float), np.asarray(commands, float), continues)
        per_row = self.substeps * len(self.rest.base)
        chunk = max(1, CHUNK_STATES // per_row)
        result = np.empty((len(states), states.shape[1]))
        for start in range(0, len(states), chunk):
            rows = slice(start, start + chunk)
            started = np.asarray(states[rows], float)
            result[rows] = self._roll(started, self.rest(started), np.asarray(commands[rows], float)[:, None])[:, 0]
        return result

    def _in_turn(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray) -> np.ndarray:
        """Simulate transitions of which each hands on to the next what is not measured; see `predict`."""
        result = np.empty((len(states), states.shape[1]))
        first = np.flatnonzero(~continues | (np.arange(len(states)) == 0))
        lengths = np.diff(np.append(first, len(states)))
        kept = None
        for step in range(int(lengths.max(initial=0))):
            rows = first[lengths > step] + step
            if kept is not None:
                kept = kept.of_rows((lengths > step)[lengths > step - 1])
            full = self.rest(states[rows], kept)
            with heard_instability() as unstable:
                ends = self._ends(full, self.layout.controls(commands[rows][:, None], states[rows][:, None]))
            self._check_time(ends, unstable)
            result[rows] = self._measured(ends, states.shape[1])[:, 0]
            kept = self.rest.keep(ends[:, 0])
        return result

    def rollout(
        self,
        initial: np.ndarray,
        commands: np.ndarray,
        holds: np.ndarray | None = None,
        driven: np.ndarray | None = None,
        earlier: np.ndarray | None = None,
    ) -> np.ndarray:
        """Simulate whole episodes in open loop; see `Simulator.rollout`.

        Args:
            initial: First states, shape (B, 2n), or with the objects' states (B, 2n + m).
            commands: Shape (B, T, n).
            holds: What held each joint in the first pose (a `InitialLoad`), shape (B, n); nothing where None.
            driven: Rows after which the servos are switched off, shape (B,); never where None.
            earlier: Commands of the control periods before the start, shape (B, L, n), for delays; NaN or None where
                they are not known: the first command where the arm begins in motion, else what holds it.
        """
        self.compiled.check(initial, commands)
        if not commands.shape[1]:
            return np.empty((len(initial), 0, initial.shape[1]))
        kept = 1 if self.hooks else self.substeps  # of the physics steps of a row
        per_row = commands.shape[1] * kept * mujoco.mj_stateSize(self.model, self._part)
        chunk = self.threads * max(1, CHUNK_STATES // max(1, per_row * self.threads))
        states = np.asarray(initial, float)
        if holds is None:
            first = self.rest(states)
        else:
            first = self.settled(states, holds, known_commands(states, np.asarray(commands, float), earlier))
        chunks = [slice(start, start + chunk) for start in range(0, len(initial), chunk)]
        parts = [
            self._roll(states[rows], first[rows], np.asarray(commands[rows]), None if driven is None else driven[rows])
            for rows in chunks
        ]
        return np.concatenate(parts) if parts else np.empty((0, commands.shape[1], initial.shape[1]))

    def rollout_settled(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes from an arm that held its weight; see `Simulator.rollout_settled`."""
        return self.rollout(initial, commands, np.full(commands.shape[::2], InitialLoad.WEIGHT))

    def stepper(self, size: int) -> "MujocoStepper":
        """Return a batch of simulations for closed loops, on one thread (more pays off only beyond 64)."""
        return MujocoStepper(self, size)

    def describe(self) -> dict[str, object]:
        """Return the source for provenance."""
        return self.compiled.describe(self.engine, mujoco.__version__)

    def _roll(
        self, states: np.ndarray, first: np.ndarray, commands: np.ndarray, driven: np.ndarray | None = None
    ) -> np.ndarray:
        """Roll out under commands (B, T, n), driven for (B,) rows.

        Args:
            states: What is measured of the first states, shape (B, 2n or 2n + m).
            first: The whole of them, shape (B, size).
            commands: What each joint is asked for.
            driven: As in `rollout`.

        Returns:
            States, shape (B, T, 2n or 2n + m).
        """
        with heard_instability() as unstable:
            controls = self.layout.controls(commands, states[:, None])
            ends = self._ends(first, controls) if driven is None else self._released(first, controls, driven)
        self._check_time(ends, unstable)
        return self._measured(ends, states.shape[1])

    def _measured(self, ends: np.ndarray, width: int) -> np.ndarray:
        """Return what is measured of full states (B, T, …), shape (B, T, width): 2n, or 2n + m with the objects."""
        nq, nv = self.model.nq, self.model.nv
        reached = ends[..., 1 : 1 + nq], ends[..., 1 + nq : 1 + nq + nv]
        measured = self.layout.measure(*reached).reshape(*ends.shape[:2], 2 * len(self.joints))
        if width == measured.shape[2]:
            return measured
        return np.concatenate([measured, self.layout.objects.measure(*reached)], axis=-1)

    def _ends(self, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return time, qpos, qvel (and more) after each control step, shape (B, T, …), for controls (B, T, nu)."""
        if self.hooks:
            return roll_hooked(self.model, self.hooks, states, controls, self.substeps, self.threads)
        return self._plain_ends(self.model, states, controls)

    def _plain_ends(self, model: mujoco.MjModel, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return full states after each control step, shape (B, T, size), of a model without hooks."""
        controls = np.repeat(controls, self.substeps, axis=1)
        full, _ = self._pool.rollout(model, self._data, states, controls, nstep=controls.shape[1])
        return np.asarray(full[:, self.substeps - 1 :: self.substeps])

    def _released(self, states: np.ndarray, controls: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Return what `_ends` does where the servos are switched off after some rows, shape (B,)."""
        if self.hooks:
            rolled = (states, controls, self.substeps, self.threads)
            return roll_hooked(self.unpowered, self.hooks, *rolled, Switching(self.model.opt.disableactuator, driven))
        ends = np.empty((*controls.shape[:2], states.shape[1]))
        for count in np.unique(np.clip(driven, 0, controls.shape[1])):
            chosen = np.clip(driven, 0, controls.shape[1]) == count
            last = states[chosen]
            if count:
                ends[chosen, :count] = self._plain_ends(self.model, last, controls[chosen, :count])
                last = ends[chosen, count - 1]
            if count < controls.shape[1]:
                ends[chosen, count:] = self._plain_ends(self.unpowered, last, controls[chosen, count:])
        return ends

    def _check_time(self, ends: np.ndarray, unstable: list[str]) -> None:
        """Refuse rollouts that the engine gave up: their clock stands still, or was reset in the very first step."""
        expected = self.period * (1 + np.arange(ends.shape[1]))
        stopped = np.abs(ends[..., 0] - expected) > 0.1 * self.model.opt.timestep * (1 + np.arange(ends.shape[1]))
        stopped |= ~np.isfinite(ends).all(axis=-1)
        if stopped.any():
            row, step = np.argwhere(stopped)[0]
            where = f"simulation {row}, {expected[step]:.3f} s after its start"
        elif unstable:
            where = unstable[0]
        else:
            return
        raise ModelFileError(
            f"{self.robot.mjcf} diverges in MuJoCo ({where}); "
            "shorten its timestep, soften its gains or check its inertias."
        )


def known_commands(states: np.ndarray, commands: np.ndarray, earlier: np.ndarray | None) -> np.ndarray:
    """Return the commands before the start, shape (B, L, n): those given, else the first where an arm is in motion.

    Args:
        states: First states, shape (B, 2n or 2n + m).
        commands: From the start on, shape (B, T, n).
        earlier: As in `MujocoSimulator.rollout`.
    """
    n = commands.shape[2]
    moving = (states[:, n : 2 * n] != 0).any(axis=1)
    likely = np.where(moving[:, None, None], commands[:, :1], np.nan)
    if earlier is None or not earlier.shape[1]:
        return likely
    return np.where(np.isfinite(earlier).all(axis=(1, 2), keepdims=True), earlier, likely)


class MujocoStepper:
    """A batch of simulations of one model in a closed loop; implements `Stepper`.

    Attributes:
        batch: The engine's batch, in which simulations may be given parameters of their own.
    """

    def __init__(self, simulator: MujocoSimulator, size: int) -> None:
        """Create the batch, every simulation at rest at zero."""
        self.simulator = simulator
        self.layout = simulator.layout
        self.joints = simulator.joints
        self.size = size
        # persistent: what is computed for the sites of a state is not computed again by the step that follows
        self.batch = mujoco.batch.Batch(simulator.model, nsim=size, nthread=1, persistent=True)
        self._rest = RestStates(simulator.model, self.layout, INTEGRATION)
        self._qpos = self.batch.bind("qpos")
        self._qvel = self.batch.bind("qvel")
        self._ctrl = self.batch.bind("ctrl")
        self._time = self.batch.bind("time")
        self._inputs, self._converts = self.layout.inputs, not self.layout.inputs.plain
        self._lost = np.zeros(size, bool)
        self._sites = self.batch.bind("site_xpos") if simulator.model.nsite else None
        self._moved = True
        self._measured: np.ndarray | None = None
        self._servos = tuple(as_slice(places) for places in (self.layout.qpos, self.layout.dof, self.layout.control))
        self._hooked = HookedBatch(self.batch, simulator.hooks) if simulator.hooks else None
        self.reset(np.zeros((size, 2 * len(self.joints))))

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (B, 2n); NaN where a simulation diverged."""
        if self._measured is None:
            self._measured = self.layout.measure(self._qpos, self._qvel)
            self._measured[self._lost] = np.nan
        return self._measured.copy()

    @property
    def objects(self) -> np.ndarray:
        """What moves beside the joints, shape (B, m); see `Stepper.objects`."""
        return self.layout.objects.measure(self._qpos, self._qvel)

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Start simulations anew; see `Stepper.reset`."""
        chosen = slice(None) if rows is None else rows
        self.batch.state[chosen] = self._rest(np.asarray(states, float))
        self._lost[chosen] = False
        self._moved, self._measured = True, None
        if self._hooked:
            self._hooked.refresh(rows)

    def guide(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.guide`."""
        objects = self.layout.objects
        self._ctrl[np.ix_(rows, objects.control)] = objects.inputs.of_commands(targets)

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        _, _, control = self._servos
        self._ctrl[:, control] = self._inputs.of_commands(commands) if self._converts else commands
        due = self._time + self.simulator.period
        with heard_instability():
            if self._hooked:
                self._hooked.step(self.simulator.substeps)
            else:
                self.batch.step(nstep=self.simulator.substeps)
        # the engine goes on from its reference posture, with its clock at zero, after a simulation diverged
        self._lost |= ~(np.abs(self._time - due) < self.simulator.model.opt.timestep / 2).reshape(self.size)
        self._moved, self._measured = True, None
        return self.states

    def set_states(self, states: np.ndarray) -> None:
        """Move the servos so that the measured state becomes `states`; play and other hidden joints keep theirs.

        Joints that follow others follow, with the slack that their constraints have.
        """
        change = states - self.states
        n = len(self.joints)
        qpos, dof, _ = self._servos
        followers = self.layout.followers
        slack = None if followers is None else followers.slack(self._qpos, self._qvel)
        self._qpos[:, qpos] += change[:, :n]
        self._qvel[:, dof] += change[:, n:]
        if followers is not None and slack is not None:
            followers.place_with(slack, self._qpos, self._qvel)
        self._moved, self._measured = True, None

    def site_positions(self, name: str) -> np.ndarray:
        """Return where a site is in the world [m], shape (B, 3).

        Raises:
            ModelFileError: the model has no such site.
        """
        site = mujoco.mj_name2id(self.simulator.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0 or self._sites is None:
            raise ModelFileError(f"{self.simulator.robot.mjcf} has no site '{name}'; add <site name='{name}'/>.")
        if self._moved:
            self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            self._moved = False
        return self._sites[:, site].copy()
