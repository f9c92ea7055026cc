"""Velocity feedback of the servo that differs from the model's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.servo import find_position_servo, is_velocity_servo, read_servo_damping, scale_damping
from nas_data.errors import ModelFileError


@dataclass(frozen=True, kw_only=True)
class ServoDamping(Effect):
    """The servo's derivative gain differs from the model's; for a velocity servo it is the gain itself.

    At a position servo, only less damping than the model's is searched for. More damping is equivalent to
    `viscous_friction` below saturation; then the latter is named, with this effect as an equal. At a velocity servo,
    a larger gain is no friction: it follows its command more closely.
    """

    factor: float

    parameters: ClassVar = (Parameter("factor", "", 0.0001, 50.0, 1.0),)
    replaces: ClassVar = "servo_damping"
    equation: ClassVar = (
        "torque = kp · (command − q) − factor · kv · dq/dt; of a velocity servo, factor · kv · (command − dq/dt)"
    )
    source: ClassVar = "MuJoCo documentation, XML reference, actuator/position: kv and dampratio; actuator/velocity: kv"
    signature: ClassVar = (
        "The joint follows commands sooner than the model, and by more the faster they are; later if more. A velocity "
        "servo with a smaller gain follows them later, and drifts under load."
    )
    confused_with: ClassVar = ("servo_stiffness", "rotor_inertia")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Half to a fiftieth of the model's gain; of a velocity servo also two to six times."""
        factors = (0.5, 0.15, 0.02, *((2.0, 6.0) if scales.velocity_servo else ()))
        return tuple({"factor": factor} for factor in factors)

    def has_preferred_equivalent(self, scales: Scales) -> bool:
        """Whether damping of a position servo increases, which is equivalent to viscous friction."""
        return self.factor > 1 and not scales.velocity_servo

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Multiply the velocity gain of the joint's servo; the joint's own damping stays.

        Raises:
            ModelFileError: no servo drives the joint, or it has no velocity feedback.
        """
        assert self.joint is not None
        if is_velocity_servo(spec, self.joint):
            scale_damping(spec, self.joint, self.factor)
            return
        actuator = find_position_servo(spec, self.joint, self.name(), may_integrate=True)
        if read_servo_damping(spec, self.joint) <= 0:
            raise ModelFileError(
                f"{self.name()} acts on a servo with velocity feedback; the actuator '{actuator.name}' of the joint "
                f"'{self.joint}' has none: its model needs kv or dampratio."
            )
        scale_damping(spec, self.joint, self.factor)
