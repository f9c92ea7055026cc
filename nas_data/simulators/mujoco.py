"""MuJoCo as a simulator: batched one-step predictions and open-loop rollouts of one model."""

import copy
import threading
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np

from nas_data.count_of import join_items
from nas_data.effects.base import Effect
from nas_data.errors import ModelFileError
from nas_data.mjcf.engine_warnings import collect_instability
from nas_data.robots.base import Robot, find_robot
from nas_data.runs.parallel import count_cores
from nas_data.simulators.compiled import CompiledRobot
from nas_data.simulators.hooks import ServoShutdown, roll_out_with_hooks
from nas_data.simulators.initial_states import InitialLoad, SettledStates
from nas_data.simulators.layout import FULLPHYSICS, INTEGRATION
from nas_data.simulators.mujoco_stepper import MujocoStepper
from nas_data.simulators.rest_states import RestStates

SERVO_GROUP = 30  # MuJoCo's last actuator group; the servos are moved to it to switch them off together
CHUNK_STATES = 250_000  # state values simulated at once, 2 MB: they fit the cache together with their inputs

_pools = threading.local()


class MujocoSimulator:
    """A robot model with effects, stepped at a control period by MuJoCo.

    Attributes:
        joints: Measured and commanded joints.
        period: Control period [s].
        substeps: Physics steps per control period.
        model: Compiled model.
        layout: Indices of the joints in the model.
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
        """Compile the model; errors as of `CompiledRobot.of`.

        Args:
            robot: Model, joints and constants.
            period: Control period [s].
            joints: Joints to measure and command.
            effects: Effects to add to the model.
            threads: Threads for batched work; all cores if None.
        """
        self.compiled = CompiledRobot.of(robot, period, joints, effects)
        self.robot, self.effects, self.period = robot, self.compiled.effects, period
        self.model, self.layout = self.compiled.model, self.compiled.layout
        self.substeps, self.hooks = self.compiled.substeps, self.compiled.hooks
        self.joints, self.slides = self.layout.joints, self.compiled.slides
        self.kinds = self.layout.kinds
        self.remembers = self.compiled.remembers
        self.object_feature = self.layout.objects.feature
        self.threads = count_cores() if threads is None else threads
        self._state_spec = INTEGRATION if self.hooks else FULLPHYSICS
        pooled = self.threads if self.threads > 1 else 0
        self._pool = find_pool(pooled)
        self._data = [mujoco.MjData(self.model) for _ in range(max(1, pooled))]

    @cached_property
    def rest(self) -> RestStates:
        """Full states at rest in any posture, without load."""
        return RestStates(self.model, self.layout, self._state_spec)

    @cached_property
    def settled(self) -> SettledStates:
        """Full states at rest in any posture, settled under the arm's weight."""
        return SettledStates(self.model, self.layout, self._state_spec, self.period, self._data[0])

    @cached_property
    def unpowered(self) -> mujoco.MjModel:
        """The same model with its servos switched off: no feedback and no back-EMF, but the same friction."""
        model = copy.copy(self.model)
        model.actuator_group[model.actuator_ctrlnum > 0] = SERVO_GROUP
        model.opt.disableactuator |= 1 << SERVO_GROUP
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
        if continues is not None and self.rest.carries_state:
            return self._predict_in_order(np.asarray(states, float), np.asarray(commands, float), continues)
        per_row = self.substeps * len(self.rest.base)
        chunk = max(1, CHUNK_STATES // per_row)
        result = np.empty((len(states), states.shape[1]))
        for start in range(0, len(states), chunk):
            rows = slice(start, start + chunk)
            first = np.asarray(states[rows], float)
            result[rows] = self._roll_out(first, self.rest(first), np.asarray(commands[rows], float)[:, None])[:, 0]
        return result

    def _predict_in_order(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray) -> np.ndarray:
        """Simulate transitions row by row; each passes its unmeasured state on to the next; see `Simulator.predict`."""
        result = np.empty((len(states), states.shape[1]))
        first = np.flatnonzero(~continues | (np.arange(len(states)) == 0))
        lengths = np.diff(np.append(first, len(states)))
        carried = None
        for step in range(int(lengths.max(initial=0))):
            rows = first[lengths > step] + step
            if carried is not None:
                carried = carried.select((lengths > step)[lengths > step - 1])
            full = self.rest(states[rows], carried)
            with collect_instability() as unstable:
                ends = self._simulate(full, self.layout.controls(commands[rows][:, None], states[rows][:, None]))
            self._check_time(ends, unstable)
            result[rows] = self._measure(ends, states.shape[1])[:, 0]
            carried = self.rest.carry(ends[:, 0])
        return result

    def rollout(
        self,
        initial: np.ndarray,
        commands: np.ndarray,
        initial_loads: np.ndarray | None = None,
        torque_off_from: np.ndarray | None = None,
        earlier_commands: np.ndarray | None = None,
    ) -> np.ndarray:
        """Simulate whole episodes in open loop; see `Simulator.rollout`.

        Args:
            initial: First states, shape (B, 2n), or with the objects' states (B, 2n + m).
            commands: Shape (B, T, n).
            initial_loads: Initial load of each joint (an `InitialLoad`), shape (B, n); no load if None.
            torque_off_from: Control steps after which the servos are switched off, shape (B,); never if None.
            earlier_commands: Commands of the L control periods before the start, shape (B, L, n). Unknown ones (NaN or
                None) are the first command for an arm in motion, or the command that holds an arm at rest.
        """
        self.compiled.check(initial, commands)
        if not commands.shape[1]:
            return np.empty((len(initial), 0, initial.shape[1]))
        stored = 1 if self.hooks else self.substeps  # states stored per control step
        per_row = commands.shape[1] * stored * mujoco.mj_stateSize(self.model, self._state_spec)
        chunk = self.threads * max(1, CHUNK_STATES // max(1, per_row * self.threads))
        states = np.asarray(initial, float)
        if initial_loads is None:
            first = self.rest(states)
        else:
            first = self.settled(
                states, initial_loads, infer_past_commands(states, np.asarray(commands, float), earlier_commands)
            )
        chunks = [slice(start, start + chunk) for start in range(0, len(initial), chunk)]
        parts = [
            self._roll_out(
                states[rows],
                first[rows],
                np.asarray(commands[rows]),
                None if torque_off_from is None else torque_off_from[rows],
            )
            for rows in chunks
        ]
        return np.concatenate(parts) if parts else np.empty((0, commands.shape[1], initial.shape[1]))

    def rollout_settled(
        self,
        initial: np.ndarray,
        commands: np.ndarray,
        initial_loads: np.ndarray | None = None,
        torque_off_from: np.ndarray | None = None,
    ) -> np.ndarray:
        """Simulate whole episodes of an arm that starts settled under a load; see `Simulator.rollout_settled`.

        `torque_off_from` is that of `rollout`.
        """
        loads = np.full(commands.shape[::2], InitialLoad.GRAVITY) if initial_loads is None else initial_loads
        return self.rollout(initial, commands, loads, torque_off_from)

    def stepper(self, size: int) -> MujocoStepper:
        """Return a batch of simulations for closed loops, on one thread (more threads pay off only beyond 64)."""
        return MujocoStepper(self, size)

    def describe(self) -> dict[str, object]:
        """Return the description of the source for provenance."""
        return self.compiled.describe(self.engine, mujoco.__version__)

    def _roll_out(
        self, states: np.ndarray, first: np.ndarray, commands: np.ndarray, torque_off_from: np.ndarray | None = None
    ) -> np.ndarray:
        """Roll out one chunk.

        Args:
            states: First measured states, shape (B, 2n or 2n + m).
            first: First full states, shape (B, size).
            commands: Shape (B, T, n).
            torque_off_from: As in `rollout`.

        Returns:
            Measured states, shape (B, T, 2n or 2n + m).
        """
        with collect_instability() as unstable:
            controls = self.layout.controls(commands, states[:, None])
            if torque_off_from is None:
                ends = self._simulate(first, controls)
            else:
                ends = self._simulate_shutdown(first, controls, torque_off_from)
        self._check_time(ends, unstable)
        return self._measure(ends, states.shape[1])

    def _measure(self, ends: np.ndarray, width: int) -> np.ndarray:
        """Return the measured part of full states (B, T, …), shape (B, T, width), for a width of 2n or 2n + m."""
        nq, nv = self.model.nq, self.model.nv
        motion = ends[..., 1 : 1 + nq], ends[..., 1 + nq : 1 + nq + nv]
        measured = self.layout.measure(*motion).reshape(*ends.shape[:2], 2 * len(self.joints))
        if width == measured.shape[2]:
            return measured
        return np.concatenate([measured, self.layout.objects.measure(*motion)], axis=-1)

    def _simulate(self, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return time, qpos, qvel and more after each control step, shape (B, T, …), for controls (B, T, nu)."""
        if self.hooks:
            return roll_out_with_hooks(self.model, self.hooks, states, controls, self.substeps, self.threads)
        return self._simulate_natively(self.model, states, controls)

    def _simulate_natively(self, model: mujoco.MjModel, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return full states after each control step, shape (B, T, size); hooks do not run."""
        controls = np.repeat(controls, self.substeps, axis=1)
        full, _ = self._pool.rollout(model, self._data, states, controls, nstep=controls.shape[1])
        return np.asarray(full[:, self.substeps - 1 :: self.substeps])

    def _simulate_shutdown(self, states: np.ndarray, controls: np.ndarray, torque_off_from: np.ndarray) -> np.ndarray:
        """Simulate, but switch the servos off after `torque_off_from` control steps, shape (B,)."""
        if self.hooks:
            shutdown = ServoShutdown(self.model.opt.disableactuator, torque_off_from)
            return roll_out_with_hooks(
                self.unpowered, self.hooks, states, controls, self.substeps, self.threads, shutdown
            )
        ends = np.empty((*controls.shape[:2], states.shape[1]))
        for count in np.unique(np.clip(torque_off_from, 0, controls.shape[1])):
            chosen = np.clip(torque_off_from, 0, controls.shape[1]) == count
            last = states[chosen]
            if count:
                ends[chosen, :count] = self._simulate_natively(self.model, last, controls[chosen, :count])
                last = ends[chosen, count - 1]
            if count < controls.shape[1]:
                ends[chosen, count:] = self._simulate_natively(self.unpowered, last, controls[chosen, count:])
        return ends

    def _check_time(self, ends: np.ndarray, unstable: list[str]) -> None:
        """Raise ModelFileError for the first rollout with a wrong time: MuJoCo stopped or reset diverged ones."""
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
        added = join_items(sorted({effect.name() for effect in self.effects}))
        raise ModelFileError(
            f"{self.robot.mjcf} diverges in MuJoCo ({where}){f' with {added}' if added else ''}; "
            + ("give its joints an armature, use integrator='implicitfast', " if added else "")
            + "shorten its timestep, soften its gains or check its inertias."
        )


def find_pool(threads: int) -> mujoco.rollout.Rollout:
    """Return the pool of worker threads of the calling thread; without workers, for 0, that thread itself simulates.

    Pools are reused, because a fit creates thousands of simulators.
    """
    pools: dict[int, mujoco.rollout.Rollout] = _pools.__dict__.setdefault("pools", {})
    if threads not in pools:
        pools[threads] = mujoco.rollout.Rollout(nthread=threads)
    return pools[threads]


def infer_past_commands(states: np.ndarray, commands: np.ndarray, earlier_commands: np.ndarray | None) -> np.ndarray:
    """Return the commands before the start, shape (B, L, n), as `MujocoSimulator.rollout` describes.

    Args:
        states: First states, shape (B, 2n or 2n + m).
        commands: Commands from the start on, shape (B, T, n).
        earlier_commands: As in `MujocoSimulator.rollout`.
    """
    n = commands.shape[2]
    moving = (states[:, n : 2 * n] != 0).any(axis=1)
    likely = np.where(moving[:, None, None], commands[:, :1], np.nan)
    if earlier_commands is None or not earlier_commands.shape[1]:
        return likely
    return np.where(np.isfinite(earlier_commands).all(axis=(1, 2), keepdims=True), earlier_commands, likely)
