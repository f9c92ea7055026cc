"""A tilted base."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales


@dataclass(frozen=True, kw_only=True)
class BaseTilt(Effect):
    """The base is rolled about the x axis, then pitched about the fixed y axis; gravity is tilted relative to it."""

    roll: float
    pitch: float

    parameters: ClassVar = (
        Parameter("roll", "rad", -0.5, 0.5, 0.0),
        Parameter("pitch", "rad", -0.5, 0.5, 0.0),
    )
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    equation: ClassVar = "g_base = (R_y(pitch) · R_x(roll))ᵀ · g"
    source: ClassVar = "Rigid-body mechanics"
    signature: ClassVar = "Static errors in all joints that share one direction in space, at every speed."
    confused_with: ClassVar = ("payload", "joint_offset")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Two degrees about each axis; the error is proportional to the angle."""
        return ({"roll": 0.03, "pitch": 0.0}, {"roll": 0.0, "pitch": 0.03})

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Rotate gravity by the inverse rotation; the base does not move."""
        spec.option.gravity = compute_rotation_matrix(self.roll, self.pitch).T @ spec.option.gravity


def compute_rotation_matrix(roll: float, pitch: float) -> np.ndarray:
    """Return the base's rotation matrix, shape (3, 3): roll [rad] about x, then pitch [rad] about the fixed y axis."""
    sin_roll, cos_roll = math.sin(roll), math.cos(roll)
    sin_pitch, cos_pitch = math.sin(pitch), math.cos(pitch)
    about_x = np.array([[1, 0, 0], [0, cos_roll, -sin_roll], [0, sin_roll, cos_roll]])
    about_y = np.array([[cos_pitch, 0, sin_pitch], [0, 1, 0], [-sin_pitch, 0, cos_pitch]])
    return np.asarray(about_y @ about_x)
