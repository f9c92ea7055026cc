"""All torques of a joint multiplied by one number.

A joint that carries no weight then moves as before, so that its recordings hardly determine this number.
"""

import math
from collections.abc import Mapping

import mujoco

from nas_data.effects.base import Effect, Parameter, make_effect
from nas_data.gap.nominal_parameters import read_own_value
from nas_data.gap.search.hypothesis import Description

KINDS = ("gain", "servo_damping", "damping", "limit", "armature", "frictionloss")  # base parameters that are torques
FACTORS = ("servo_stiffness", "servo_damping")  # effects that multiply a torque
UNITS = ("N·m", "kg·m²")  # beginnings of the units of other parameters in proportion to a torque
ADDED = ("coulomb_friction", "viscous_friction", "rotor_inertia")  # effects whose amount is added to the model's own
Start = tuple[Description, dict[str, float]]  # description with initial values, and factors of the model's parameters
LEAST = 1e-9  # smallest amount [N·m …], so that its logarithm is finite


def scale_torques(
    description: Description, factors: Mapping[str, float], spec: mujoco.MjSpec, ratios: Mapping[str, float]
) -> Start:
    """Return a description and its factors with the torques of some joints multiplied by a number.

    Base parameters that are not freed, and amounts that the model itself has, stay as they are.

    Args:
        description: Effects and freed parameters.
        factors: Factors of the model's parameters, by name.
        spec: Model.
        ratios: Number by which a joint's torques are multiplied, by joint.
    """
    effects = [scale_effect(effect, spec, ratios.get(effect.local_joint or "", 1.0)) for effect in description.effects]
    scaled = dict(factors)
    for name in description.freed:
        joint, kind = name.rsplit(".", 1)
        if kind in KINDS:
            scaled[name] = factors.get(name, 1.0) * ratios.get(joint, 1.0)  # a fit clips it to its bounds
    return description.with_effects(effects), scaled


def scale_effect(effect: Effect, spec: mujoco.MjSpec, ratio: float) -> Effect:
    """Return an effect with its torques multiplied by a ratio, within their bounds."""
    if effect.joint is None or ratio == 1.0:
        return effect
    values = {parameter.name: float(getattr(effect, parameter.name)) for parameter in effect.parameters}
    for parameter in effect.parameters:
        if is_torque(effect, parameter) and math.isfinite(values[parameter.name]):
            own = read_own_value(spec, effect.joint, effect.replaces) if effect.name() in ADDED else 0.0
            value = ratio * (own + values[parameter.name]) - own
            low = parameter.low if parameter.low < 0 else max(parameter.low, LEAST)
            values[parameter.name] = min(max(value, low), parameter.high)
    return make_effect(effect.name(), effect.joint, values)


def is_torque(effect: Effect, parameter: Parameter) -> bool:
    """Whether a parameter of an effect is in proportion to a torque."""
    return parameter.unit.startswith(UNITS) or (effect.name() in FACTORS and parameter is effect.parameters[0])


def find_sufficient_ratio(effect: Effect, spec: mujoco.MjSpec) -> float | None:
    """Return the ratio at which a joint's torques need not be changed by an effect; None if there is none.

    At that ratio a gain has the model's value, or added friction or inertia is no more than the model's own.
    """
    if effect.joint is None or effect.local_joint is None:
        return None
    value = float(getattr(effect, effect.parameters[0].name))
    if effect.name() in FACTORS:
        return 1 / value
    own = read_own_value(spec, effect.joint, effect.replaces) if effect.name() in ADDED else 0.0
    return own / (own + value) if own > 0 else None


def leave_out(description: Description, factors: Mapping[str, float], spec: mujoco.MjSpec, number: int) -> Start | None:
    """Return a description without an effect that a ratio of all torques of its joint replaces; None if none does.

    Args:
        description: Effects and freed parameters.
        factors: Factors of the model's parameters, by name.
        spec: Model.
        number: Index of the effect.
    """
    effect = description.effects[number]
    ratio = find_sufficient_ratio(effect, spec)
    if ratio is None or effect.joint is None:
        return None
    return scale_torques(description.without_effect(number), factors, spec, {effect.joint: ratio})
