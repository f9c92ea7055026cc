"""Friction that decreases from break-away as speed rises."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from nas_data.effects.base import Effect, Parameter, Scales
from nas_data.effects.edits.holding import stiffen_friction
from nas_data.effects.edits.passive import add_passive
from nas_data.effects.edits.servo import move_limit_to_servo
from nas_data.mjcf.unique_name import make_unique_name

KINETIC_SHARE = 1e-3  # share of the bristles' friction that remains at speed; MuJoCo divides by it
STIFF = 2.0  # stiffness · timestep² / inertia: at 1 a load may break them away too early, at 4 they oscillate


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(Effect):
    """In addition to the model's friction: `torque` at break-away, `kinetic_ratio · torque` at speed.

    The kinetic part is the joint's frictionloss, which holds without creep. The part that decreases with speed is LuGre
    friction (bristles) of a passive actuator `<joint>_stribeck`, which follows the model's own actuators.
    """

    torque: float
    kinetic_ratio: float
    stribeck_velocity: float

    parameters: ClassVar = (
        Parameter("torque", "N·m", 0.0, 200.0, 0.0),
        Parameter("kinetic_ratio", "", 0.2, 1.0, 1.0),
        Parameter("stribeck_velocity", "rad/s", 0.002, 5.0, 1.0),
    )
    edit_order: ClassVar = 2
    replaces: ClassVar = "frictionloss"
    equation: ClassVar = (
        "friction = torque · (kinetic_ratio + (1 − kinetic_ratio) · exp(−(v / stribeck_velocity)²)) · sign(v), "
        "v = dq/dt"
    )
    source: ClassVar = "Stribeck curve as in Rhoban/bam, friction model M2; MuJoCo 4.0 <dcmotor lugre>"
    signature: ClassVar = (
        "A delay and a jump at break-away, stick-slip on slow moves; less friction the faster it moves."
    )
    confused_with: ClassVar = ("coulomb_friction", "load_friction", "deadband", "backlash")

    @property
    def is_neutral(self) -> bool:
        """Whether the torque is zero; the other parameters then have no effect."""
        return self.torque == 0

    @classmethod
    def guesses(cls, scales: Scales) -> tuple[Mapping[str, float], ...]:
        """Break-away that stops the servo two and eight degrees short of its goal, with three Stribeck velocities."""
        return tuple(
            {
                "torque": angle * scales.radian * scales.stiffness,
                "kinetic_ratio": 0.4,
                "stribeck_velocity": velocity * scales.radian,
            }
            for angle in (0.04, 0.15)
            for velocity in (0.06, 0.25, 1.0)
        )

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add the kinetic part to the joint's frictionloss, and the rest as bristles."""
        assert self.joint is not None
        spec.joint(self.joint).frictionloss += self.torque * self.kinetic_ratio
        stiffen_friction(spec, self.joint)
        if self.kinetic_ratio < 1:
            move_limit_to_servo(spec, self.joint)
            add_bristles(spec, self.joint, self.torque * (1 - self.kinetic_ratio), self.stribeck_velocity)


def add_bristles(spec: mujoco.MjSpec, joint: str, torque: float, velocity: float) -> None:
    """Add LuGre friction to a joint: torque · exp(−(v / velocity)²), torque in N·m, velocity in rad/s.

    The bristles are half as stiff as the timestep allows for the joint's inertia, so that their deflection is below
    the resolution of sensors. They have no damping, which MuJoCo would treat as inertia; the joint's frictionloss damps
    them. A load that jumps within one step by more than frictionloss + inertia · velocity / timestep breaks them away.
    """
    model = spec.compile()
    inertia = 1 / float(model.dof_invweight0[model.joint(joint).dofadr[0]])  # at the reference posture [kg·m²]
    lugre = np.array([STIFF * inertia / spec.option.timestep**2, 0.0, KINETIC_SHARE * torque, torque, velocity])
    add_passive(spec, make_unique_name(spec.actuator, f"{joint}_stribeck"), mujoco.mjtTrn.mjTRN_JOINT, joint, lugre)
