"""Saturation torque of the servo."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco

from nas_data.effects.base import Effect, Parameter, Scales, find_joint_actuator
from nas_data.effects.edits.servo import has_torque_limit, set_force_limit, set_joint_limit
from nas_data.mjcf.actuator_lookup import CURVE, GOAL_GAIN


@dataclass(frozen=True, kw_only=True)
class TorqueLimit(Effect):
    """The servo's torque saturates here, independent of the model's limit."""

    torque: float

    parameters: ClassVar = (Parameter("torque", "N·m", 0.005, 5000.0, math.inf),)
    equation: ClassVar = "|torque of the servo| ≤ torque"
    source: ClassVar = "XL-320 e-manual, Torque Limit (register 35); MuJoCo actuator forcerange"
    signature: ClassVar = "Only in big steps and heavy postures: constant acceleration, droop that ignores the error."
    confused_with: ClassVar = ("speed_limit", "payload", "servo_stiffness", "acceleration_limit")

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """A fifth to four fifths of the model's torque."""
        return tuple({"torque": share * scales.torque} for share in (0.2, 0.45, 0.8))

    @classmethod
    def vanishing_value(cls, scales: Scales) -> float:
        """Return the model's torque, above which a limit has no effect."""
        return scales.torque

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Set the force range of the actuator and, if it has one, of the joint.

        With a goal joint only that of the joint; with a motor curve, whose limit falls with speed, only that of the
        actuator.
        """
        assert self.joint is not None
        actuator, joint = find_joint_actuator(spec, self.joint), spec.joint(self.joint)
        has_goal, has_curve = (spec.actuator(self.joint + part) is not None for part in (GOAL_GAIN, CURVE))
        if has_goal or (has_torque_limit(joint) and not has_curve):
            set_joint_limit(joint, self.torque)
        if not has_goal:
            set_force_limit(actuator, self.torque)
