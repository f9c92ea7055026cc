"""How well something predicts the episodes that were never handed over."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.resimulate import Delivered, find_actuators
from nas_data.benchmarks.blind.write import FRESH, NOMINAL
from nas_data.errors import NasError

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
