"""Friction that is largest at rest and falls as motion starts."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.bristles import add_bristles
from nas_data.effects.edits.holding import hold_firmly


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(Effect):
    """Beyond the model's own friction: `torque` to break away, `kinetic_ratio · torque` at speed.

    The kinetic part is the joint's friction loss, which holds without creep. What fades with speed is a passive
    actuator `<joint>_stribeck` with bristles (LuGre); it has no control and comes after the model's own actuators.
    """

    torque: float
    kinetic_ratio: float
    stribeck_velocity: float

    parameters: ClassVar = (
        Parameter("torque", "N·m", 0.0, 200.0, 0.0),
        Parameter("kinetic_ratio", "", 0.2, 1.0, 1.0),
        Parameter("stribeck_velocity", "rad/s", 0.002, 5.0, 1.0),
    )
    late: ClassVar = 2
    replaces: ClassVar = "frictionloss"
    equation: ClassVar = (
        "friction = torque · (kinetic_ratio + (1 − kinetic_ratio) · exp(−(v / stribeck_velocity)²)) · sign(v), "
        "v = dq/dt"
    )
    source: ClassVar = "Stribeck curve as in Rhoban/bam, friction model M2; MuJoCo 4.0 <dcmotor lugre>"
    signature: ClassVar = (
        "A delay and a jump at break-away, stick-slip on slow moves; less friction the faster it moves."
    )
    confused_with: ClassVar = ("coulomb_friction", "load_friction", "deadband", "backlash")

    @property
    def is_neutral(self) -> bool:
        """Whether there is no torque; its fall with speed then has nothing to act on."""
        return self.torque == 0

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Break-away that stops the servo short by two and eight degrees, falling off slowly and fast."""
        return tuple(
            {
                "torque": angle * scales.radian * scales.stiffness,
                "kinetic_ratio": 0.4,
                "stribeck_velocity": velocity * scales.radian,
            }
            for angle in (0.04, 0.15)
            for velocity in (0.06, 0.25, 1.0)
        )

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the kinetic part to the joint's friction loss and the rest as bristles."""
        assert self.joint is not None
        spec.joint(self.joint).frictionloss += self.torque * self.kinetic_ratio
        hold_firmly(spec, self.joint)
        if self.kinetic_ratio < 1:
            add_bristles(spec, self.joint, self.torque * (1 - self.kinetic_ratio), self.stribeck_velocity)
