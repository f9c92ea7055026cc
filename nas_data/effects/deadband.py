"""A position error that the servo ignores."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.band import add_band
from nas_data.effects.edits.servo import find_position_servo


@dataclass(frozen=True, kw_only=True)
class Deadband(Effect):
    """Within `half_width` of its goal the servo gives no torque; beyond it the error counts from the band's edge.

    In the model the servo, with its delay and slew rate, moves a massless joint `<joint>_deadband_goal`. Passive
    actuators with the servo's stiffness, dead band, damping and torque limit act between that goal and the joint.
    Within the band, a command change acts for one physics step.
    """

    half_width: float

    parameters: ClassVar = (Parameter("half_width", "rad", 0.0, 0.2, 0.0),)
    edit_order: ClassVar = 2
    equation: ClassVar = "torque = kp · dz(command − q) − kv · dq/dt, dz(e) = sign(e) · max(|e| − half_width, 0)"
    source: ClassVar = "Robotis e-manuals, compliance margin of AX and MX servos"
    signature: ClassVar = (
        "A static error of either sign up to a fixed width, at any load; small moves are not followed."
    )
    confused_with: ClassVar = ("backlash", "coulomb_friction", "stribeck_friction", "joint_offset", "start_torque")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half a degree to four degrees."""
        return tuple({"half_width": width * scales.radian} for width in (0.008, 0.025, 0.07))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add a dead band to the joint's servo, or widen an existing one.

        Raises:
            ModelFileError: no position servo drives the joint, or the servo has an integral gain.
        """
        assert self.joint is not None
        servo = find_position_servo(spec, self.joint, self.name())
        add_band(spec, self.joint, servo, self.half_width)
