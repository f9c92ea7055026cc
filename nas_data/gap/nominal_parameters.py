"""Base parameters: quantities of the given model that a real arm has a few percent different."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from nas_data.effects.edits.holding import stiffen_friction
from nas_data.effects.edits.servo import (
    is_velocity_servo,
    read_filter_time,
    read_servo_damping,
    read_servo_stiffness,
    read_torque_limit,
    scale_damping,
    scale_filter,
    scale_limit,
    scale_stiffness,
)

Kind = Literal["mass", "gain", "damping", "servo_damping", "armature", "frictionloss", "filter", "limit", "gravcomp"]
TOLERANCE = 0.06  # standard deviation σ of a base parameter's logarithm
FITTED_TOLERANCE = 0.01  # the same for a model that was fitted to a recording of this robot
MORE_FRICTION = 0.02  # σ for friction above the model's, which is an effect
MAX_LOG_CHANGE = float(np.log(1.25))  # bound; a larger change is a missing effect
FREE_DEVIATION = 2.0  # σ of a freed parameter; published gains of one servo differ by a factor of 6
HIGHER_LIMIT = 0.3  # σ of a freed torque limit above the model's: a rating, which also says how large all torques are
LARGEST_IMPEDANCE = 0.9999  # the largest that MuJoCo accepts
FIRM = ".solimpfriction"  # end of the name of a factor on the impedance of a joint's friction, which no fit changes
FREE_LOG_CHANGE = float(np.log(1000.0))  # bound of a freed parameter


@dataclass(frozen=True)
class NominalParameter:
    """A base parameter of the model.

    Attributes:
        joint: Its joint; a mass belongs to the joint that moves it.
        kind: Physical quantity.
        bodies: Bodies whose mass and inertia, or gravity compensation, it scales.
        is_free: Whether it is freed, with wide prior and bounds.
        tolerance: Standard deviation of its logarithm, unless it is freed.
    """

    joint: str
    kind: Kind
    bodies: tuple[str, ...] = ()
    is_free: bool = False
    tolerance: float = TOLERANCE

    def with_free_prior(self) -> "NominalParameter":
        """Return the parameter as a freed one."""
        return replace(self, is_free=True)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the logarithm of its factor."""
        furthest = FREE_LOG_CHANGE if self.is_free else MAX_LOG_CHANGE
        return -furthest, furthest

    def deviation(self, logarithm: float) -> float:
        """Return the prior's standard deviation of its logarithm, on the side of a value."""
        if self.is_free:
            return HIGHER_LIMIT if self.kind == "limit" and logarithm > 0 else FREE_DEVIATION
        is_more_friction = self.kind == "frictionloss" and logarithm > 0
        return min(MORE_FRICTION, self.tolerance) if is_more_friction else self.tolerance

    @property
    def name(self) -> str:
        """Name in reports, for example `m2.damping`."""
        return f"{self.joint}.{self.kind}"

    def scale(self, spec: mujoco.MjSpec, factor: float) -> None:
        """Multiply it by a factor in a model."""
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


def read_own_value(spec: mujoco.MjSpec, joint: str, kind: str) -> float:
    """Return a joint's damping, armature, frictionloss or torque limit [SI]; 0 for other kinds."""
    element = spec.joint(joint)
    if kind == "limit":
        return read_torque_limit(spec, joint)
    if kind == "damping":
        return float(element.damping[0])
    return float(getattr(element, kind)) if kind in {"armature", "frictionloss"} else 0.0


def read_own_amount(spec: mujoco.MjSpec, joint: str, kind: str) -> float:
    """Return the amount of a quantity in the model [SI]; for damping including the servo's."""
    if kind == "damping":
        return read_own_value(spec, joint, kind) + max(read_servo_damping(spec, joint), 0.0)
    return read_own_value(spec, joint, kind)


def list_base_parameters(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[NominalParameter, ...]:
    """Return the base parameters of a model's measured joints."""
    model = spec.copy().compile()
    found = []
    for joint in joints:
        bodies = find_moved_bodies(model, joint, joints)
        if bodies:
            found.append(NominalParameter(joint, "mass", bodies))
        if held := tuple(name for name in bodies if spec.body(name).gravcomp > 0):
            found.append(NominalParameter(joint, "gravcomp", held))
        element = spec.joint(joint)
        if read_servo_stiffness(spec, joint) > 0:
            found.append(NominalParameter(joint, "gain"))
        if element.damping[0] > 0:
            found.append(NominalParameter(joint, "damping"))
        is_servo = read_servo_stiffness(spec, joint) > 0 or is_velocity_servo(spec, joint)
        if is_servo and np.isfinite(read_torque_limit(spec, joint)):
            found.append(NominalParameter(joint, "limit"))
        if read_filter_time(spec, joint) > 0:
            found.append(NominalParameter(joint, "filter"))
        if read_servo_damping(spec, joint) > 0:
            found.append(NominalParameter(joint, "servo_damping"))
        if element.armature > 0:
            found.append(NominalParameter(joint, "armature"))
        if element.frictionloss > 0:
            found.append(NominalParameter(joint, "frictionloss"))
    return tuple(found)


def find_moved_bodies(model: mujoco.MjModel, joint: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the bodies with mass that a joint moves and no later measured joint does, also one of the same body."""
    own = model.joint(joint)
    first = int(own.bodyid[0])
    rest = [model.joint(name) for name in joints if name != joint]
    if any(other.bodyid[0] == first and other.id > own.id for other in rest):
        return ()
    others = {int(other.bodyid[0]) for other in rest}
    found = []
    for body in range(1, model.nbody):
        above = body
        while above not in (0, first) and above not in others:
            above = int(model.body_parentid[above])
        if above == first and model.body_mass[body] > 0:
            found.append(model.body(body).name)
    return tuple(found)


def scale_base_parameters(spec: mujoco.MjSpec, base: Sequence[NominalParameter], factors: Mapping[str, float]) -> None:
    """Multiply base parameters of a model with explicit inertias, and impedances of friction, by factors, by name."""
    for parameter in base:
        if (factor := factors.get(parameter.name, 1.0)) != 1.0:
            parameter.scale(spec, factor)
    for name, factor in factors.items():
        if name.endswith(FIRM):
            joint = name.removesuffix(FIRM)
            stiffen_friction(spec, joint, min(factor * float(spec.joint(joint).solimp_friction[0]), LARGEST_IMPEDANCE))
