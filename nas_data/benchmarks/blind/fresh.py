"""How well something predicts the episodes that were never handed over."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.resimulate import Delivered, find_actuators
from nas_data.benchmarks.blind.write import FRESH, NOMINAL
from nas_data.errors import NasError

# commands (E, T, n), first positions and speeds (E, 2n) → positions (E, T, n)
Predict = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Fresh:
    """Episodes that were kept back.

    Attributes:
        joints: Names of the measured joints.
        rate: Control rate [Hz].
        commands: [rad, N m], shape (E, T, n).
        positions: True positions [rad], shape (E, T + 1, n).
        readings: The same with noise and rounding.
        starts: Where a prediction starts, positions [rad] then speeds [rad/s], shape (E, 2n).
    """

    joints: tuple[str, ...]
    rate: float
    commands: np.ndarray
    positions: np.ndarray
    readings: np.ndarray
    starts: np.ndarray

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

    def error(self, predict: Predict) -> float:
        """Return a prediction's RMSE over all joints and steps [rad]; infinite where it left all bounds."""
        predicted = predict(self.commands, self.starts)
        error = float(np.sqrt(np.square(predicted - self.readings[:, 1:]).mean()))
        return error if np.isfinite(error) else float("inf")

    def errors_of_models(self, folder: Path, delivered: Path) -> dict[str, float | str]:
        """Return the RMSE [rad] of the nominal model, of the delivered one, and the floor."""
        servos = find_actuators(folder / NOMINAL, self.joints)
        result: dict[str, float | str] = {"floor": self.floor}
        result["before"] = self.error(self._load_model(folder / NOMINAL, servos).play)
        try:
            result["after"] = self.error(self._load_model(delivered, servos).play)
        except NasError as error:  # what was delivered is being judged: that it cannot be used is a finding
            result |= {"after": float("inf"), "fault": str(error)}
        return result

    def error_of(self, model: mujoco.MjModel, nominal: Path) -> float:
        """Return the RMSE [rad] of a compiled model whose actuators are those of a nominal one's file."""
        servos = find_actuators(nominal, self.joints)
        return self.error(Delivered.of(model, self.joints, servos, self.rate, nominal).play)

    def _load_model(self, file: Path, servos: tuple[str, ...]) -> Delivered:
        return Delivered.load(file, self.joints, servos, self.rate)
