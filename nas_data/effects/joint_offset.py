"""A constant angle between the commanded and the reached position."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.asymmetric_friction import AsymmetricFriction
from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import find_position_servo, shift_rest

ROOM = 1.2  # initial torque of the equivalent friction over its difference, which is at most as large


@dataclass(frozen=True, kw_only=True)
class JointOffset(Effect):
    """The servo's zero is wrong: without load it reaches the command plus the offset."""

    offset: float

    parameters: ClassVar = (Parameter("offset", "rad", -0.5, 0.5, 0.0),)
    equation: ClassVar = "torque = servo(command + offset − q)"
    source: ClassVar = "Rhoban/bam, q_offset; horn and encoder zero errors of 0.5 to 4°"
    signature: ClassVar = "A constant static error, the same in every posture, direction and load."
    confused_with: ClassVar = ("base_tilt", "payload", "deadband", "asymmetric_friction")

    @property
    def constant_error(self) -> float:
        """The offset [rad; slides m]."""
        return self.offset

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Two degrees; the error is proportional to the offset."""
        return ({"offset": 0.03 * scales.radian},)

    def equivalents(self, scales: Scales) -> tuple[Effect, ...]:
        """Return friction that differs by direction, which beside dry friction is equivalent below saturation."""
        force = scales.stiffness * self.offset
        if not 0 < ROOM * abs(force) < AsymmetricFriction.parameters[0].high:
            return ()
        return (AsymmetricFriction(joint=self.joint, torque=ROOM * abs(force), difference=-force),)

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Shift the servo's rest position by the offset."""
        assert self.joint is not None
        shift_rest(spec, self.joint, find_position_servo(spec, self.joint, self.name()), self.offset)
