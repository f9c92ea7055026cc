"""Partial gravity compensation by the controller."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales


@dataclass(frozen=True, kw_only=True)
class GravityCompensation(Effect):
    """The controller adds torques that compensate a share of the gravity of all bodies."""

    share: float

    parameters: ClassVar = (Parameter("share", "", 0.0, 1.0, 0.0),)
    whole_arm: ClassVar = True
    per_joint: ClassVar = False
    equation: ClassVar = "τ = share · g(q)"
    source: ClassVar = "Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), section 8.5; MuJoCo's gravcomp"
    signature: ClassVar = "All joints sag less than the model by the same share, at every posture and speed."
    confused_with: ClassVar = ("payload", "servo_stiffness", "base_tilt")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half of gravity; the error is proportional to the share."""
        return ({"share": 0.5},)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Compensate this share of the gravity that the model does not compensate already."""
        for body in spec.bodies:
            body.gravcomp += self.share * (1.0 - body.gravcomp)
