"""Dry friction that differs by direction."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.coulomb_friction import HOLDING
from nas_data.effects.edits.holding import stiffen_friction
from nas_data.effects.edits.passive import add_passive, set_bias
from nas_data.effects.edits.servo import move_limit_to_servo
from nas_data.mjcf.unique_name import make_unique_name


@dataclass(frozen=True, kw_only=True)
class AsymmetricFriction(Effect):
    """In addition to the model's friction: torque + difference in positive direction, torque − difference in negative.

    `difference` is thus half of the difference of both frictions; a positive one means more friction in the positive
    direction. Its size is at most `torque`, because a larger one would push a joint at rest: the excess has no effect.

    At rest it holds any load from difference − torque to difference + torque. In the model this is the joint's
    frictionloss of `torque`, and a passive actuator `<joint>_asymmetry` with the constant torque −difference. Below
    saturation that constant shifts a position servo like a `joint_offset` of −difference / stiffness. Together with
    `coulomb_friction` it is then equivalent to this effect, and more common; at such servos both are named instead.
    """

    torque: float
    difference: float

    parameters: ClassVar = (
        Parameter("torque", "N·m", 0.0, 200.0, 0.0),
        Parameter("difference", "N·m", -200.0, 200.0, 0.0, scaled_by="torque"),
    )
    replaces: ClassVar = "frictionloss"
    equation: ClassVar = "friction = torque · sign(v) + difference, v = dq/dt, |difference| ≤ torque"
    source: ClassVar = "Canudas de Wit, Åström and Braun 1987 (doi:10.1109/JRA.1987.1087103)"
    signature: ClassVar = "As dry friction, but it stops further from the goal in one direction than in the other."
    confused_with: ClassVar = ("coulomb_friction", "joint_offset", "stribeck_friction", "backlash")

    @property
    def is_neutral(self) -> bool:
        """Whether the torque is zero; the difference then has no effect."""
        return self.torque == 0

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Friction that stops a servo two and eight degrees short of its goal, more of it in either direction."""
        torques = [angle * scales.radian * scales.stiffness for angle in (0.04, 0.15)]
        return tuple({"torque": torque, "difference": share * torque} for torque in torques for share in (-0.4, 0.4))

    def has_preferred_equivalent(self, scales: Scales) -> bool:
        """Whether a position servo drives the joint: symmetric friction and an offset are equivalent there."""
        return scales.position_servo

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the torque to the joint's frictionloss, reduce creep, and add the constant torque."""
        assert self.joint is not None
        spec.joint(self.joint).frictionloss += self.torque
        stiffen_friction(spec, self.joint, HOLDING)
        shift = float(np.clip(self.difference, -self.torque, self.torque))
        if shift:
            move_limit_to_servo(spec, self.joint)
            name = make_unique_name(spec.actuator, f"{self.joint}_asymmetry")
            set_bias(add_passive(spec, name, mujoco.mjtTrn.mjTRN_JOINT, self.joint), -shift)
