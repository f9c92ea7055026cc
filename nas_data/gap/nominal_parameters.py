"""Parameters that a model has: masses, gains, damping, rotor inertia; a real arm's are a few percent off."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from nas_data.effects.edits.servo import (
    damping,
    filter_time,
    scale_damping,
    scale_filter,
    scale_limit,
    scale_stiffness,
    stiffness,
    torque_limit,
)

Kind = Literal["mass", "gain", "damping", "servo_damping", "armature", "frictionloss", "filter", "limit", "gravcomp"]
TOLERANCE = 0.06  # [-] standard deviation of a base parameter's logarithm: a few to ten percent off
MORE_FRICTION = 0.02  # the same for friction above the model's, which has a name
MAX_LOG_CHANGE = float(np.log(1.25))  # beyond ±25 % a change is a missing effect, not a retuned parameter
FREE_DEVIATION = 2.0  # the same where a parameter may be anything: published gains of one servo differ by a factor of 6
FREE_LOG_CHANGE = float(np.log(1000.0))


@dataclass(frozen=True)
class NominalParameter:
    """One number of the model that may be off by some percent.

    Attributes:
        joint: Joint it belongs to; a mass belongs to the joint that moves it.
        kind: Which.
        bodies: Bodies whose mass and inertia, or gravity compensation, it scales.
        is_free: Whether it may be anything, not just a few percent off.
    """

    joint: str
    kind: Kind
    bodies: tuple[str, ...] = ()
    is_free: bool = False

    def with_free_prior(self) -> "NominalParameter":
        """Return the parameter as one that may be anything."""
        return replace(self, is_free=True)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest logarithm of its factor."""
        furthest = FREE_LOG_CHANGE if self.is_free else MAX_LOG_CHANGE
        return -furthest, furthest

    def deviation(self, logarithm: float) -> float:
        """Return the standard deviation of its logarithm, on the side on which a value lies."""
        if self.is_free:
            return FREE_DEVIATION
        return MORE_FRICTION if self.kind == "frictionloss" and logarithm > 0 else TOLERANCE

    @property
    def name(self) -> str:
        """Name in reports, for example `m2.damping`."""
        return f"{self.joint}.{self.kind}"

    def scale(self, spec: mujoco.MjSpec, factor: float) -> None:
        """Multiply it in a model."""
        if self.kind == "mass":
            for name in self.bodies:
                body = spec.body(name)
                body.mass *= factor
                body.inertia = body.inertia * factor
        elif self.kind == "gravcomp":
            for name in self.bodies:
                spec.body(name).gravcomp *= factor
        elif self.kind == "gain":
            scale_stiffness(spec, self.joint, factor)
        elif self.kind == "servo_damping":
            scale_damping(spec, self.joint, factor)
        elif self.kind == "filter":
            scale_filter(spec, self.joint, factor)
        elif self.kind == "limit":
            scale_limit(spec, self.joint, factor)
        else:
            joint = spec.joint(self.joint)
            setattr(joint, self.kind, getattr(joint, self.kind) * factor)


def own_value(spec: mujoco.MjSpec, joint: str, kind: str) -> float:
    """Return a joint's own damping, armature, frictionloss or torque limit, in SI units; 0 of other kinds."""
    element = spec.joint(joint)
    if kind == "limit":
        return torque_limit(spec, joint)
    if kind == "damping":
        return float(element.damping[0])
    return float(getattr(element, kind)) if kind in {"armature", "frictionloss"} else 0.0


def own_size(spec: mujoco.MjSpec, joint: str, kind: str) -> float:
    """Return what the model has of something that effects add to; of damping its servo's as well, in SI units."""
    if kind == "damping":
        return own_value(spec, joint, kind) + max(damping(spec, joint), 0.0)
    return own_value(spec, joint, kind)


def base_parameters(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[NominalParameter, ...]:
    """Return the base parameters of a model's measured joints."""
    model = spec.copy().compile()
    found = []
    for joint in joints:
        bodies = bodies_moved_by(model, joint, joints)
        if bodies:
            found.append(NominalParameter(joint, "mass", bodies))
        if held := tuple(name for name in bodies if spec.body(name).gravcomp > 0):
            found.append(NominalParameter(joint, "gravcomp", held))
        element = spec.joint(joint)
        if stiffness(spec, joint) > 0:
            found.append(NominalParameter(joint, "gain"))
        if element.damping[0] > 0:
            found.append(NominalParameter(joint, "damping"))
        if stiffness(spec, joint) > 0 and np.isfinite(torque_limit(spec, joint)):
            found.append(NominalParameter(joint, "limit"))
        if filter_time(spec, joint) > 0:
            found.append(NominalParameter(joint, "filter"))
        if damping(spec, joint) > 0:
            found.append(NominalParameter(joint, "servo_damping"))
        if element.armature > 0:
            found.append(NominalParameter(joint, "armature"))
        if element.frictionloss > 0:
            found.append(NominalParameter(joint, "frictionloss"))
    return tuple(found)


def bodies_moved_by(model: mujoco.MjModel, joint: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the bodies with mass that a joint moves and no later measured joint does."""
    first = int(model.joint(joint).bodyid[0])
    others = {int(model.joint(name).bodyid[0]) for name in joints if name != joint}
    found = []
    for body in range(1, model.nbody):
        above = body
        while above not in (0, first) and above not in others:
            above = int(model.body_parentid[above])
        if above == first and model.body_mass[body] > 0:
            found.append(model.body(body).name)
    return tuple(found)


def apply_base(spec: mujoco.MjSpec, base: Sequence[NominalParameter], factors: Mapping[str, float]) -> None:
    """Multiply base parameters of an explicit model by their factors, by name."""
    for parameter in base:
        if (factor := factors.get(parameter.name, 1.0)) != 1.0:
            parameter.scale(spec, factor)
