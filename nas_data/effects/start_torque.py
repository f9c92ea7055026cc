"""Least torque that a servo gives once its position differs from the goal."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.band import add_start_torque
from nas_data.effects.edits.servo import find_position_servo


@dataclass(frozen=True, kw_only=True)
class StartTorque(Effect):
    """Small position errors get this torque instead of a smaller one; at the goal the servo gives none.

    The model has the goal joint of a servo with a dead band (see `Deadband`), and the passive actuator
    `<joint>_start_torque`. In a simulation with timesteps the sign of the error is a steep line: the torque is reached
    at an error of 2 · torque · timestep² / inertia. With a dead band, the error counts from the band's edge.
    """

    torque: float

    parameters: ClassVar = (Parameter("torque", "N·m", 0.0, 200.0, 0.0),)
    edit_order: ClassVar = 2
    equation: ClassVar = "torque = sign(e) · max(kp · |e|, torque) − kv · dq/dt, e = command − q; 0 at e = 0"
    source: ClassVar = (
        "Robotis AX-12A e-manual, Punch (register 48); Feetech STS3215, minimum startup force (register 24)"
    )
    signature: ClassVar = (
        "Small errors are corrected with a jerk, and at rest none is left unless the load exceeds the torque; "
        "without friction it trembles about the goal."
    )
    confused_with: ClassVar = ("servo_stiffness", "coulomb_friction", "stribeck_friction", "deadband")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """The servo's torque at errors of one and four degrees."""
        return tuple({"torque": angle * scales.radian * scales.stiffness} for angle in (0.02, 0.07))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the torque to the joint's servo; of two such torques the larger one holds.

        Raises:
            ModelFileError: no position servo drives the joint, or the servo has an integral gain.
        """
        assert self.joint is not None
        add_start_torque(spec, self.joint, find_position_servo(spec, self.joint, self.name()), self.torque)
