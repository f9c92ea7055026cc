"""How well something predicts the episodes that were never handed over; who knows the answer included."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.case import SealedAnswer
from nas_data.benchmarks.blind.plants.mujoco_plant import multiply
from nas_data.benchmarks.blind.resimulate import Delivered, find_actuators
from nas_data.benchmarks.blind.write import FRESH, NOMINAL
from nas_data.effects.base import Effect, Scales, add_effects, find_joint_actuator, make_effect
from nas_data.effects.edits.series import ensure_measured_tendon
from nas_data.effects.edits.servo import read_force_range, read_servo_stiffness
from nas_data.errors import ModelFileError, NasError, UnknownName

# commands (E, T, n), first positions and speeds (E, 2n) → positions (E, T, n)
Predict = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class FreshErrors:
    """Errors of a prediction of the fresh episodes, RMSE [rad]."""

    floor: float  # of a perfect prediction
    after: float | None  # of the prediction; None where it left all bounds, or nothing could be predicted


@dataclass(frozen=True, kw_only=True)
class ModelErrors(FreshErrors):
    """Errors of a delivered model, and of others beside it."""

    before: float | None  # of the nominal model; None where it left all bounds
    # why the delivered model cannot be used; None if it can
    fault: str | None = field(default=None, metadata={"optional": True})
    least: float | None = None  # of who knows the answer; None where no model file says it


@dataclass(frozen=True)
class Fresh:
    """Episodes that were kept back."""

    joints: tuple[str, ...]  # names of the measured joints
    rate: float  # control rate [Hz]
    commands: np.ndarray  # [rad, N m], shape (E, T, n)
    positions: np.ndarray  # True positions [rad], shape (E, T + 1, n)
    readings: np.ndarray  # the same with noise and rounding
    starts: np.ndarray  # where a prediction starts, positions [rad] then speeds [rad/s], shape (E, 2n)

    @classmethod
    def load(cls, folder: Path, joints: tuple[str, ...]) -> "Fresh":
        """Read them from a case's folder."""
        with np.load(folder / FRESH) as stored:
            readings = stored["readings"]
            still = np.concatenate([readings[:, 0], np.zeros_like(readings[:, 0])], axis=1)
            starts = stored.get("starts", still)
            return cls(joints, float(stored["rate"]), stored["commands"], stored["positions"], readings, starts)

    @property
    def floor(self) -> float:
        """RMSE that a perfect prediction would have, of noise and rounding alone [rad]."""
        return float(np.sqrt(np.square(self.readings - self.positions)[:, 1:].mean()))

    def error(self, predict: Predict) -> float | None:
        """Return a prediction's RMSE over all joints and steps [rad]; None where it left all bounds."""
        predicted = predict(self.commands, self.starts)
        error = float(np.sqrt(np.square(predicted - self.readings[:, 1:]).mean()))
        return error if np.isfinite(error) else None

    def errors_of_models(self, folder: Path, delivered: Path, least: float | None = None) -> ModelErrors:
        """Return the errors of the nominal model and of the delivered one, beside that of who knows the answer."""
        servos, after, fault = find_actuators(folder / NOMINAL, self.joints), None, None
        before = self.error(self._load_model(folder / NOMINAL, servos).play)
        try:
            after = self.error(self._load_model(delivered, servos).play)
        except NasError as error:  # what was delivered is being judged: that it cannot be used is a finding
            fault = str(error)
        return ModelErrors(floor=self.floor, before=before, after=after, fault=fault, least=least)

    def error_of(self, model: mujoco.MjModel, nominal: Path) -> float | None:
        """Return the RMSE [rad] of a compiled model whose actuators are those of a nominal one's file."""
        servos = find_actuators(nominal, self.joints)
        return self.error(Delivered.of(model, self.joints, servos, self.rate, nominal).play)

    def _load_model(self, file: Path, servos: tuple[str, ...]) -> Delivered:
        return Delivered.load(file, self.joints, servos, self.rate)


WINDOW = 0.05  # [s] over which speeds are taken
LEAN = 0.5  # [rad] of error at which a servo without limits gives a large torque
FINE = 0.0005  # [s] physics step at which what a step costs is below the noise


def compute_oracle_error(folder: Path, answer: SealedAnswer, fresh: Fresh) -> float | None:
    """Return the RMSE [rad] on the fresh episodes of a case's model with the true effects, at the true base.

    Fresh episodes start at the first measured pose, whatever was commanded before. Who names everything rightly still
    errs until a play, a band or a delayed command has been forgotten; nobody should be asked for less.

    Returns:
        None where the answer is outside the catalogue or beyond a model file, or the model left all bounds.
    """
    try:
        effects = [make_effect(entry.effect, entry.joint, entry.parameters) for entry in answer.effects]
    except UnknownName:
        return None
    spec = mujoco.MjSpec.from_file(str(folder / NOMINAL))
    spec.option.timestep = min(spec.option.timestep, FINE)
    multiply(spec, fresh.joints, answer.base)
    forms = [effect.written_form(measure_scales(spec, effect, fresh)) for effect in effects]
    try:
        add_effects(spec, [form for form in forms if form is not None])
    except ModelFileError:
        return None
    for joint in fresh.joints:
        ensure_measured_tendon(spec, joint)
    return None if None in forms else fresh.error_of(spec.compile(), folder / NOMINAL)


def measure_scales(spec: mujoco.MjSpec, effect: Effect, fresh: Fresh) -> Scales:
    """Return what is large at an effect's joint, by model and fresh episodes; at the first one for the arm's effects.

    A load friction's form in a file is made for a torque and a speed, and for nothing else.
    """
    joint = fresh.joints[0] if effect.joint is None else effect.joint
    gap = max(1, round(WINDOW * fresh.rate))
    moved = np.abs(fresh.positions[:, gap:] - fresh.positions[:, :-gap])[..., fresh.joints.index(joint)]
    speed = float(np.percentile(moved, 98)) * fresh.rate / gap
    limits = read_force_range(find_joint_actuator(spec, joint))
    torque = max(map(abs, limits)) if limits else read_servo_stiffness(spec, joint) * LEAN
    return Scales(read_servo_stiffness(spec, joint), 0.0, 0.0, 0.0, torque, speed)
