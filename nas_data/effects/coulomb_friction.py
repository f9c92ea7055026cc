"""Friction that opposes motion with a constant torque, beyond the model's own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales

# impedance at which friction holds: at MuJoCo's default, 0.9, an XL-320 under load creeps by a degree a second
HOLDING = 0.99


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """A torque of constant size against motion; at rest it holds whatever load is smaller."""

    torque: float

    parameters: ClassVar = (Parameter("torque", "N·m", 0.0, 200.0, 0.0),)
    replaces: ClassVar = "frictionloss"
    equation: ClassVar = "friction = torque · sign(dq/dt)"
    source: ClassVar = "MuJoCo joint frictionloss; Rhoban/bam, friction model M1"
    signature: ClassVar = "Stops short of the goal on the side it comes from; an offset that flips at every reversal."
    confused_with: ClassVar = ("backlash", "stribeck_friction", "load_friction", "deadband")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Friction that stops the servo short by one to ten degrees."""
        return tuple({"torque": angle * scales.radian * scales.stiffness} for angle in (0.02, 0.06, 0.2))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the torque to the joint's friction loss, and let it hold rather than creep."""
        joint = spec.joint(self.joint)
        joint.frictionloss += self.torque
        impedance = joint.solimp_friction.copy()
        impedance[:2] = np.maximum(impedance[:2], HOLDING)
        joint.solimp_friction = impedance
        if joint.solref_friction[0] > 0:  # a negative one is a stiffness, which somebody chose on purpose
            joint.solref_friction = [2 * spec.option.timestep, 1.0]
