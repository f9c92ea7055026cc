"""Given model, with the changes that a hypothesis makes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.explicit_values import make_values_explicit
from nas_data.effects.edits.servo import find_position_servo, scale_stiffness
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.integrator import FINE_TIMESTEP, find_whole_step, make_implicit
from nas_data.gap.nominal_parameters import NominalParameter, list_base_parameters, scale_base_parameters
from nas_data.gap.side_by_side import is_sharing_cores
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.mjcf.measured_joints import mark_measured_joints
from nas_data.mjcf.strip_meshes import count_colliding_geoms, needs_files, strip_meshes
from nas_data.mjcf.timestep import set_timestep
from nas_data.robots.base import Robot, find_robot, list_actuated_joints, list_slide_joints
from nas_data.simulators.initial_states import START_SECONDS, InitialLoad, choose_initial_loads
from nas_data.simulators.lock_joints import lock_unmeasured_joints
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.servo_registers import NO_REGISTERS, ServoRegisters


@dataclass(frozen=True)
class PreparedRobot(Robot):
    """A robot whose model is in memory.

    Attributes:
        prepared: Model.
    """

    prepared: mujoco.MjSpec = field(default_factory=mujoco.MjSpec)

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable copy."""
        return self.prepared.copy()


@dataclass(frozen=True)
class Nominal:
    """Model as given, prepared for a search.

    Attributes:
        robot: Its file, joints and constants.
        spec: Model with explicit inertias.
        lean: The same without meshes that cannot collide, which compiles faster and has equal dynamics.
        joints: Measured joints.
        period: Control period [s].
        base: Base parameters.
        notes: One sentence for each deviation from the given model.
        registers: Registers of the recording that the model was given.
        known: Sentences on the recording's registers.
    """

    robot: Robot
    spec: mujoco.MjSpec
    lean: mujoco.MjSpec
    joints: tuple[str, ...]
    period: float
    base: tuple[NominalParameter, ...]
    notes: tuple[str, ...] = ()
    registers: ServoRegisters = NO_REGISTERS
    known: tuple[str, ...] = ()

    @classmethod
    def load(cls, model: str | Path, evidence: EpisodeBatch, registers: ServoRegisters = NO_REGISTERS) -> "Nominal":
        """Read the model; its timestep is shortened so that it divides a control period.

        Args:
            model: Robot's name or model file.
            evidence: Episodes with joints and control period.
            registers: Registers of the recording, which the model is given.

        Raises:
            ModelFileError, JointMismatch: it cannot be used, or has other joints than the recording.
        """
        given = find_robot(model)
        robot = registers.set_in(given)
        MujocoSimulator(robot, evidence.period, evidence.joints)  # raises for a model that cannot be used
        spec = bake_inertia(robot.spec())
        make_values_explicit(spec)
        mark_measured_joints(spec, evidence.joints, list_actuated_joints(spec))
        set_timestep(spec, find_whole_step(evidence.period, spec.option.timestep))
        bases = [f"The base '{base}' has a free joint; it is fixed at its pose in the model." for base in robot.bases]
        notes = (*bases, *adapt_model(spec, evidence.joints, evidence.period))
        base = list_base_parameters(spec, evidence.joints)
        known = registers.describe(given)
        lean = strip_idle_meshes(spec)
        held = registers.select_stated(given)
        return cls(robot, spec, lean, evidence.joints, evidence.period, base, notes, held, known)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the measured slides."""
        found = list_slide_joints(self.spec)
        return tuple(joint for joint in self.joints if joint in found)

    def make_spec(self, factors: Mapping[str, float], lean: bool = False) -> mujoco.MjSpec:
        """Return the model with base parameters multiplied by factors, by name.

        Args:
            factors: Factors; missing ones are 1.
            lean: Whether to leave out meshes that cannot collide.
        """
        spec = (self.lean if lean else self.spec).copy()
        scale_base_parameters(spec, self.base, factors)
        return spec

    def with_tolerance(self, tolerance: float) -> "Nominal":
        """Return the model with another standard deviation of the base parameters' logarithms."""
        return replace(self, base=tuple(replace(parameter, tolerance=tolerance) for parameter in self.base))

    def with_edit(self, edit: Callable[[mujoco.MjSpec], None]) -> "Nominal":
        """Return the model with an edit of its spec."""
        spec, lean = self.spec.copy(), self.lean.copy()
        edit(spec)
        edit(lean)
        return replace(self, spec=spec, lean=lean)

    def simulator(self, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None) -> MujocoSimulator:
        """Return a simulator of the model with effects and factors of base parameters."""
        known = {name: getattr(self.robot, name) for name in ("name", "mjcf", "joints", "rate", "rest")}
        robot = PreparedRobot(**known, prepared=self.make_spec(factors or {}, lean=True), adapted=True)
        simulator = MujocoSimulator(robot, self.period, self.joints, effects, 1 if is_sharing_cores() else None)
        simulator.model.opt.disableflags |= find_disable_flags(simulator.model)
        return simulator

    def predict(
        self, evidence: EpisodeBatch, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Roll out the episodes from their initial states; return positions [rad; m], shape (E, T, n).

        Each episode is simulated at its own gains, and without servo torque where that is off.

        Raises:
            ModelFileError: the model with these effects diverges or does not compile.
        """
        predicted = np.empty(evidence.measured.shape)
        for nominal, chosen in self.group_by_gain(evidence):
            predicted[chosen] = nominal.rollout(evidence.select(chosen), effects, factors)
        return predicted

    def step(self, evidence: EpisodeBatch, states: np.ndarray) -> np.ndarray:
        """Simulate one control step from each recorded state, at its episode's gain.

        Args:
            evidence: E episodes of up to T rows of n joints; rows after their ends stay 0.
            states: Measured state before each row, shape (E, T, 2n), or with the objects' (E, T, 2n + m).

        Returns:
            Positions one control step later [rad; m], shape (E, T, n).
        """
        predicted = np.zeros(evidence.measured.shape)
        for nominal, chosen in self.group_by_gain(evidence):
            rows = evidence.mask & np.isin(np.arange(len(evidence.mask)), chosen)[:, None]
            continues = np.broadcast_to(np.arange(rows.shape[1]) > 0, rows.shape)[rows]
            stepped = nominal.simulator().predict(states[rows], evidence.commands[rows], continues)
            predicted[rows] = stepped[:, : len(self.joints)]
        return predicted

    def infer_initial_loads(
        self, evidence: EpisodeBatch, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None
    ) -> EpisodeBatch:
        """Return the episodes with the initial loads that explain their first second best; see `choose_initial_loads`.

        A model without unmeasured state gets the weight of the arm everywhere.

        Raises:
            ModelFileError: the simulation diverges.
        """
        if not self.simulator(effects, factors).remembers:
            return evidence.with_initial_loads(InitialLoad.GRAVITY)
        early = evidence.first(max(1, round(START_SECONDS / evidence.period)))
        rolled = [self.predict(early.with_initial_loads(load), effects, factors) for load in InitialLoad]
        squares = np.stack([early.mean_squares(predicted) for predicted in rolled])
        return evidence.with_initial_loads(choose_initial_loads(squares, evidence.noise))

    def group_by_gain(self, evidence: EpisodeBatch) -> Iterator[tuple["Nominal", np.ndarray]]:
        """Yield the model at each position gain of a recording, with the indices of its episodes."""
        for gains in np.unique(evidence.gains, axis=0):
            yield self.with_gains(gains), np.flatnonzero((evidence.gains == gains).all(axis=1))

    def rollout(
        self, evidence: EpisodeBatch, effects: Sequence[Effect], factors: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Roll out the episodes at the model's own gain; see `predict`."""
        driven = None if (evidence.torque_off_from >= evidence.commands.shape[1]).all() else evidence.torque_off_from
        start = evidence.initial, evidence.commands, evidence.initial_loads, driven, evidence.earlier_commands
        rolled = self.simulator(effects, factors).rollout(*start)
        return rolled[..., : len(self.joints)]

    def with_gains(self, gains: np.ndarray) -> "Nominal":
        """Return the model with position gains multiplied, shape (n,); torque limits and damping stay."""
        if (gains == 1).all():
            return self

        def scale(spec: mujoco.MjSpec) -> None:
            for joint, gain in zip(self.joints, gains, strict=True):
                if gain != 1:
                    find_position_servo(spec, joint, "A position gain of the recording")
                    scale_stiffness(spec, joint, float(gain))

        return self.with_edit(scale)


def adapt_model(spec: mujoco.MjSpec, joints: Sequence[str], period: float) -> tuple[str, ...]:
    """Set an integrator for stiff effects, and lock joints without data; return a sentence for each change."""
    changed, held = make_implicit(spec, period), lock_unmeasured_joints(spec, joints)
    still = f"Held at their reference, because the recording lacks them: {', '.join(held)}." if held else ""
    return tuple(note for note in (changed, still) if note)


def find_disable_flags(model: mujoco.MjModel) -> int:
    """Return disable flags that save a fifth of a rollout's time at equal positions."""
    flags = mujoco.mjtDisableBit.mjDSBL_SENSOR.value | mujoco.mjtDisableBit.mjDSBL_ISLAND.value
    touching = (model.geom_contype[:, None] & model.geom_conaffinity[None, :]).any() or model.npair
    return int(flags if touching else flags | mujoco.mjtDisableBit.mjDSBL_CONTACT.value)


def find_fine_timestep(nominal: Nominal) -> float:
    """Return a timestep of at most 0.5 ms that divides a control period [s]."""
    return min(float(nominal.spec.option.timestep), find_whole_step(nominal.period, FINE_TIMESTEP))


def with_timestep(nominal: Nominal, timestep: float) -> Nominal:
    """Return the model with another timestep [s]."""
    return nominal.with_edit(lambda spec: set_timestep(spec, timestep))


def strip_idle_meshes(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the model without meshes, or unchanged if it has none or some can collide."""
    touches = not spec.option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) and count_colliding_geoms(spec)
    return spec if touches or not needs_files(spec) else strip_meshes(spec)
