"""Friction of constant torque against motion, in addition to the model's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.holding import stiffen_friction

HOLDING = 0.99  # impedance (solimp) of the friction; at MuJoCo's 0.9 a loaded XL-320 creeps by a degree per second


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """A constant torque against motion; at rest it holds any smaller load."""

    torque: float

    parameters: ClassVar = (Parameter("torque", "N·m", 0.0, 200.0, 0.0),)
    replaces: ClassVar = "frictionloss"
    equation: ClassVar = "friction = torque · sign(dq/dt)"
    source: ClassVar = "MuJoCo joint frictionloss; Rhoban/bam, friction model M1"
    signature: ClassVar = "Stops short of the goal on the side it comes from; an offset that flips at every reversal."
    confused_with: ClassVar = ("backlash", "stribeck_friction", "load_friction", "deadband", "start_torque")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Friction that stops the servo one to ten degrees short of its goal."""
        return tuple({"torque": angle * scales.radian * scales.stiffness} for angle in (0.02, 0.06, 0.2))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the torque to the joint's frictionloss, and reduce creep."""
        assert self.joint is not None
        spec.joint(self.joint).frictionloss += self.torque
        stiffen_friction(spec, self.joint, HOLDING)
