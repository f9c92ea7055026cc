"""Reflected rotor inertia, in addition to the model's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales


@dataclass(frozen=True, kw_only=True)
class RotorInertia(Effect):
    """Inertia of the rotor at the joint: squared gear ratio times the rotor's inertia."""

    inertia: float

    parameters: ClassVar = (Parameter("inertia", "kg·m²", 0.0, 100.0, 0.0),)
    replaces: ClassVar = "armature"
    equation: ClassVar = "torque = inertia · d²q/dt²"
    source: ClassVar = "MuJoCo joint armature; Rhoban/bam, armature"
    signature: ClassVar = "Slower acceleration and lower, longer ringing, the same in every posture; no droop."
    confused_with: ClassVar = ("payload", "command_delay", "torque_limit", "acceleration_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half to five times the model's inertia."""
        return tuple({"inertia": share * scales.inertia} for share in (0.5, 1.5, 5.0))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the inertia to the joint's armature."""
        spec.joint(self.joint).armature += self.inertia
