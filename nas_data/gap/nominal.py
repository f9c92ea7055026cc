"""The model that was handed over, with everything that a hypothesis about the gap may change."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.derived_servo_values import fix_derived_values
from nas_data.effects.edits.servo import position_servo, scale_stiffness
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.integrator import FINE, make_implicit, whole_step
from nas_data.gap.nominal_parameters import NominalParameter, apply_base, base_parameters
from nas_data.gap.side_by_side import shares_cores
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.mjcf.strip_meshes import colliding_shapes, needs_files, strip_meshes
from nas_data.robots.base import Robot, find_robot, slide_joints
from nas_data.simulators.lock_joints import lock_unmeasured_joints
from nas_data.simulators.mujoco import MujocoSimulator


@dataclass(frozen=True)
class PreparedRobot(Robot):
    """A robot whose model is at hand and not read from its file again.

    Attributes:
        prepared: The model.
    """

    prepared: mujoco.MjSpec = field(default_factory=mujoco.MjSpec)

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable copy."""
        return self.prepared.copy()


@dataclass(frozen=True)
class Nominal:
    """A robot model as handed over.

    Attributes:
        robot: Its file, joints and constants.
        spec: The model with explicit inertias.
        lean: The same without meshes that touch nothing, which compiles faster; it moves alike.
        joints: Measured joints.
        period: Control period [s].
        base: Parameters that may be off by some percent.
        notes: What of the model is simulated otherwise than it was handed over, a sentence each.
    """

    robot: Robot
    spec: mujoco.MjSpec
    lean: mujoco.MjSpec
    joints: tuple[str, ...]
    period: float
    base: tuple[NominalParameter, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def load(cls, model: str | Path, evidence: EpisodeBatch) -> "Nominal":
        """Read the model; its physics step is shortened to one of which whole numbers make a control period.

        Raises:
            ModelFileError, JointMismatch: it cannot be used, or has other joints than the recording.
        """
        robot = find_robot(model)
        MujocoSimulator(robot, evidence.period, evidence.joints)  # says what is wrong with the model, if anything
        spec = bake_inertia(robot.spec())
        fix_derived_values(spec)
        spec.option.timestep = whole_step(evidence.period, spec.option.timestep)
        bases = [f"The base '{base}' would fall; it is held where the model has it." for base in robot.bases]
        notes = (*bases, *adapt(spec, evidence.joints, evidence.period))
        base = base_parameters(spec, evidence.joints)
        return cls(robot, spec, without_meshes(spec), evidence.joints, evidence.period, base, notes)

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the measured joints that are slides."""
        found = slide_joints(self.spec)
        return tuple(joint for joint in self.joints if joint in found)

    def edited(self, factors: Mapping[str, float], lean: bool = False) -> mujoco.MjSpec:
        """Return the model with parameters multiplied by factors, by name.

        Args:
            factors: Those of 1 may be left out.
            lean: Whether meshes that touch nothing are left out.
        """
        spec = (self.lean if lean else self.spec).copy()
        apply_base(spec, self.base, factors)
        return spec

    def changed(self, edit: Callable[[mujoco.MjSpec], None]) -> "Nominal":
        """Return the nominal model with an edit of its spec."""
        spec, lean = self.spec.copy(), self.lean.copy()
        edit(spec)
        edit(lean)
        return replace(self, spec=spec, lean=lean)

    def simulator(self, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None) -> MujocoSimulator:
        """Return the model with effects and changed base parameters, ready to simulate."""
        known = {name: getattr(self.robot, name) for name in ("name", "mjcf", "joints", "rate", "rest")}
        robot = PreparedRobot(**known, prepared=self.edited(factors or {}, lean=True), adapted=True)
        simulator = MujocoSimulator(robot, self.period, self.joints, effects, 1 if shares_cores() else None)
        simulator.model.opt.disableflags |= disable_flags(simulator.model)
        return simulator

    def predict(
        self, evidence: EpisodeBatch, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Roll the episodes out from their first pose, held as they say; return positions [rad], shape (E, T, n).

        Each episode is simulated at its own gain, and falls freely where its torque is off.

        Raises:
            ModelFileError: the model with these effects diverges or does not compile.
        """
        predicted = np.empty(evidence.measured.shape)
        for nominal, chosen in self.by_gain(evidence):
            predicted[chosen] = nominal.rolled(evidence.select(chosen), effects, factors)
        return predicted

    def step(self, evidence: EpisodeBatch, states: np.ndarray) -> np.ndarray:
        """Simulate each recorded row alone, at its episode's gain.

        Args:
            evidence: E episodes of up to T rows of n joints; rows after their ends stay 0.
            states: Measured state before each row, shape (E, T, 2n), or with the objects' (E, T, 2n + m).

        Returns:
            Positions one control step later [rad], shape (E, T, n).
        """
        predicted = np.zeros(evidence.measured.shape)
        for nominal, chosen in self.by_gain(evidence):
            rows = evidence.mask & np.isin(np.arange(len(evidence.mask)), chosen)[:, None]
            continues = np.broadcast_to(np.arange(rows.shape[1]) > 0, rows.shape)[rows]
            stepped = nominal.simulator().predict(states[rows], evidence.commands[rows], continues)
            predicted[rows] = stepped[:, : len(self.joints)]
        return predicted

    def by_gain(self, evidence: EpisodeBatch) -> Iterator[tuple["Nominal", np.ndarray]]:
        """Return the model at each position gain of a recording, and which episodes have it."""
        for gains in np.unique(evidence.gains, axis=0):
            yield self.with_gains(gains), np.flatnonzero((evidence.gains == gains).all(axis=1))

    def rolled(
        self, evidence: EpisodeBatch, effects: Sequence[Effect], factors: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Roll the episodes out at the model's own gain; see `predict`."""
        driven = None if (evidence.torque_off_from >= evidence.commands.shape[1]).all() else evidence.torque_off_from
        start = evidence.initial, evidence.commands, evidence.initial_loads, driven, evidence.earlier_commands
        rolled = self.simulator(effects, factors).rollout(*start)
        return rolled[..., : len(self.joints)]

    def with_gains(self, gains: np.ndarray) -> "Nominal":
        """Return the model with the position gains of its servos multiplied, shape (n,); limits and damping stay."""
        if (gains == 1).all():
            return self

        def scale(spec: mujoco.MjSpec) -> None:
            for joint, gain in zip(self.joints, gains, strict=True):
                if gain != 1:
                    position_servo(spec, joint, "A position gain of the recording")
                    scale_stiffness(spec, joint, float(gain))

        return self.changed(scale)


def adapt(spec: mujoco.MjSpec, joints: Sequence[str], period: float) -> tuple[str, ...]:
    """Make of a model what recording and effects take it to be; return what was changed, a sentence each."""
    changed, held = make_implicit(spec, period), lock_unmeasured_joints(spec, joints)
    still = f"Held at their reference, as the recording lacks them: {', '.join(held)}." if held else ""
    return tuple(note for note in (changed, still) if note)


def disable_flags(model: mujoco.MjModel) -> int:
    """Return what a rollout can do without at the same positions, as disable flags: a fifth of its time."""
    flags = mujoco.mjtDisableBit.mjDSBL_SENSOR.value | mujoco.mjtDisableBit.mjDSBL_ISLAND.value
    touching = (model.geom_contype[:, None] & model.geom_conaffinity[None, :]).any() or model.npair
    return int(flags if touching else flags | mujoco.mjtDisableBit.mjDSBL_CONTACT.value)


def fine_timestep(nominal: Nominal) -> float:
    """Return a physics step of at most half a millisecond of which whole numbers make a control period [s]."""
    return min(float(nominal.spec.option.timestep), whole_step(nominal.period, FINE))


def with_timestep(nominal: Nominal, timestep: float) -> Nominal:
    """Return the nominal model with another physics timestep [s]."""

    def shorten(spec: mujoco.MjSpec) -> None:
        spec.option.timestep = timestep

    return nominal.changed(shorten)


def without_meshes(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a model without the meshes that touch nothing; the model itself where it has none, or some touch."""
    touches = not spec.option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT) and colliding_shapes(spec)
    return spec if touches or not needs_files(spec) else strip_meshes(spec)
