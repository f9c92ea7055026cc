"""Reflected inertia of the drive, beyond the model's own."""

from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter


@dataclass(frozen=True, kw_only=True)
class RotorInertia(Effect):
    """The rotor behind the gear, as inertia at the joint: gear ratio squared times the rotor's own."""

    inertia: float

    parameters: ClassVar = (Parameter("inertia", "kg·m²", 0.0, 0.2, 0.0),)
    equation: ClassVar = "torque = inertia · d²q/dt²"
    source: ClassVar = "MuJoCo joint armature; Rhoban/bam, armature"
    signature: ClassVar = "Slower acceleration and lower, longer ringing, the same in every posture; no droop."
    confused_with: ClassVar = ("payload", "command_delay", "torque_limit")

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the inertia to the joint's armature."""
        spec.joint(self.joint).armature += self.inertia
