"""Friction proportional to speed, in addition to the model's damping."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.servo_damping import ServoDamping


@dataclass(frozen=True, kw_only=True)
class ViscousFriction(Effect):
    """A torque against motion that is proportional to speed; below saturation it is equivalent to servo damping."""

    coefficient: float

    parameters: ClassVar = (Parameter("coefficient", "N·m·s/rad", 0.0, 5000.0, 0.0),)
    replaces: ClassVar = "damping"
    equation: ClassVar = "friction = coefficient · dq/dt"
    source: ClassVar = "Rhoban/bam, friction model M1"
    signature: ClassVar = "An error proportional to speed, none at rest; constant-speed moves lag by a constant angle."
    confused_with: ClassVar = ("speed_limit", "command_delay", "servo_stiffness")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half to four times the model's damping."""
        return tuple({"coefficient": share * max(scales.damping, 1e-4)} for share in (0.5, 1.5, 4.0))

    def equivalents(self, scales: Scales) -> tuple[Effect, ...]:
        """Return more velocity feedback of the servo, which is equivalent below saturation."""
        return (ServoDamping(joint=self.joint, factor=3.0),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the coefficient to the joint's damping."""
        joint = spec.joint(self.joint)
        damping = joint.damping.copy()
        damping[0] += self.coefficient
        joint.damping = damping
