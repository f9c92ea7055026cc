"""Position gain of the servo that differs from the model's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import find_position_servo, scale_stiffness


@dataclass(frozen=True, kw_only=True)
class ServoStiffness(Effect):
    """The servo's proportional gain or supply voltage differs from the model's."""

    factor: float

    parameters: ClassVar = (Parameter("factor", "", 0.005, 20.0, 1.0),)
    replaces: ClassVar = "gain"
    equation: ClassVar = "torque = factor · kp · (command − q) − kv · dq/dt"
    source: ClassVar = "XL-320 e-manual, P gain (register 29)"
    signature: ClassVar = "Droop under load and bandwidth change together, in proportion, in every posture."
    confused_with: ClassVar = ("payload", "coulomb_friction", "joint_compliance", "start_torque")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """A hundredth to three times the gain; gains of some models are far too high."""
        return tuple({"factor": factor} for factor in (0.01, 0.04, 0.15, 0.5, 1.6, 2.8))

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Multiply the position gain of the joint's servo; damping and limits stay.

        Raises:
            ModelFileError: the joint's actuator has no position feedback.
        """
        assert self.joint is not None
        find_position_servo(spec, self.joint, self.name(), may_integrate=True)
        scale_stiffness(spec, self.joint, self.factor)
