"""Quantities of an identified model by joint, with their confidence intervals."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from nas_data.effects.base import Effect, Parameter, add_effects, make_effect
from nas_data.effects.edits.servo import is_velocity_servo, read_servo_damping, read_servo_stiffness, read_torque_limit
from nas_data.errors import OptionError
from nas_data.gap.nominal import Nominal
from nas_data.gap.report import REPORT
from nas_data.gap.report_effects import FittedEffect
from nas_data.gap.write_model import EFFECTS
from nas_data.joint_units import convert_hinge_unit
from nas_data.typed_json import from_json

ROUNDING = 1e-9  # relative difference up to which values are equal
RELATIVE_TOLERANCE = 1e-3  # relative difference up to which a rounded value of a report equals that of an effects.json
UNITS = {
    "gain": "N·m/rad",
    "servo_damping": "N·m·s/rad",
    "velocity_gain": "N·m·s/rad",
    "armature": "kg·m²",
    "dry_friction": "N·m",
    "viscous_friction": "N·m·s/rad",
    "torque_limit": "N·m",
    "mass": "kg",
}
# Quantities of every joint, units at a hinge. The velocity feedback of a servo is `velocity_gain` if it is all that the
# servo has, and `servo_damping` beside a gain. `mass` is that of the bodies that no later joint moves.

Interval = tuple[float, float]
Intervals = Mapping[tuple[str, str | None, str], Interval]  # by effect, joint and parameter


@dataclass(frozen=True)
class Quantity:
    """One quantity of an identified model.

    Attributes:
        joint: Its joint; None for the whole arm.
        name: One of `UNITS`, or an effect or `effect.parameter`.
        unit: Unit; empty for a ratio.
        value: Value.
        interval: 95 % confidence interval; None if unknown.
    """

    joint: str | None
    name: str
    unit: str
    value: float
    interval: Interval | None


def list_quantities(
    nominal: Nominal, effects: Sequence[Effect], factors: Mapping[str, float], intervals: Intervals
) -> list[Quantity]:
    """Return the quantities of each joint, then of the arm.

    For an effect that changes a quantity of the joint, such as its friction, the quantity is read from the model with
    the effect. Both ends of its interval are read in the same way. Other effects are listed by their parameters.

    Args:
        nominal: Given model.
        effects: Named effects.
        factors: Factors of base parameters, by name.
        intervals: Known intervals of the effects' parameters.
    """
    spec = nominal.make_spec(factors)
    moved = {parameter.joint: parameter.bodies for parameter in nominal.base if parameter.kind == "mass"}
    found: list[Quantity] = []
    for joint in (*nominal.joints, None):
        own = [effect for effect in effects if effect.joint == joint]
        if joint is not None:
            found += _list_joint_quantities(spec, joint, own, intervals, joint in nominal.slides)
            mass = sum(float(spec.body(name).mass) for name in moved.get(joint, ()))
            found += [Quantity(joint, "mass", UNITS["mass"], mass, None)] if mass else []
        for effect in own:
            found += _list_effect_quantities(spec, effect, intervals, joint in nominal.slides)
    return found


def read_intervals(path: Path, effects: Sequence[Effect]) -> Intervals:
    """Return the 95 % intervals of effects' parameters from their report; empty without a report.

    Args:
        path: Folder of a report, or one of its files.
        effects: Effects; intervals of other values are ignored.

    Raises:
        OptionError: the report is malformed.
    """
    report = (path if path.is_dir() else path.parent) / REPORT
    if path.suffix == ".json" and path.name != EFFECTS:
        report = path
    if not report.is_file():
        return {}
    try:
        content = json.loads(report.read_text(encoding="utf-8"))
        entries = [
            entry
            for entry in (content["effects"] if isinstance(content, dict) else content)
            if any(isinstance(number, dict) for number in entry["parameters"].values())  # else without intervals
        ]
        known = {
            (effect.name, effect.joint, name): (number.value, *number.interval95)
            for effect in (from_json(FittedEffect, entry) for entry in entries)
            for name, number in effect.parameters.items()
            if number.interval95 is not None
        }
    except (OSError, KeyError, TypeError, ValueError, AttributeError):
        raise OptionError(f"{report} is not a gap report; give the folder that `nas gap` wrote.") from None
    values = {
        (effect.name(), effect.joint, parameter.name): float(getattr(effect, parameter.name))
        for effect in effects
        for parameter in effect.free_parameters
    }
    return {
        key: (low, high)
        for key, (value, low, high) in known.items()
        if key in values and math.isclose(value, values[key], rel_tol=RELATIVE_TOLERANCE)
    }


def _read_quantities(spec: mujoco.MjSpec, joint: str, effects: Sequence[Effect]) -> dict[str, float]:
    """Return the quantities of a joint with some effects."""
    edited = spec.copy()
    add_effects(edited, effects)
    element, feedback = edited.joint(joint), max(read_servo_damping(edited, joint), 0.0)
    speeds_only = is_velocity_servo(edited, joint)
    return {
        "gain": max(read_servo_stiffness(edited, joint), 0.0),
        "servo_damping": 0.0 if speeds_only else feedback,
        "velocity_gain": feedback if speeds_only else 0.0,
        "armature": float(element.armature),
        "dry_friction": float(element.frictionloss),
        "viscous_friction": float(element.damping[0]),
        "torque_limit": read_torque_limit(edited, joint),
    }


def _list_joint_quantities(
    spec: mujoco.MjSpec, joint: str, effects: Sequence[Effect], intervals: Intervals, slide: bool
) -> list[Quantity]:
    """Return the quantities `UNITS` of a joint, without zero and infinite ones."""
    value = _read_quantities(spec, joint, effects)
    low, high, known = dict(value), dict(value), set()
    for place, effect in enumerate(effects):
        for parameter in effect.free_parameters:
            ends = intervals.get((effect.name(), joint, parameter.name))
            if ends is None:
                continue
            moved = [_read_quantities(spec, joint, _replace_parameter(effects, place, parameter, end)) for end in ends]
            for name, number in value.items():
                off = [other[name] - number for other in moved if math.isfinite(other[name]) and math.isfinite(number)]
                if any(off):
                    known.add(name)
                    low[name] += min(0.0, *off)
                    high[name] += max(0.0, *off)
    return [
        Quantity(
            joint,
            name,
            convert_hinge_unit(unit, slide),
            value[name],
            (low[name], high[name]) if name in known else None,
        )
        for name, unit in UNITS.items()
        if 0 < value.get(name, 0.0) < math.inf
    ]


def _list_effect_quantities(spec: mujoco.MjSpec, effect: Effect, intervals: Intervals, slide: bool) -> list[Quantity]:
    """Return an effect's parameters; empty for a single parameter that a quantity of the joint includes."""
    several = len(effect.free_parameters) > 1
    if effect.local_joint is not None and not several:
        before, after = (_read_quantities(spec, effect.local_joint, effects).values() for effects in ([], [effect]))
        if not all(math.isclose(*pair, rel_tol=ROUNDING) for pair in zip(before, after, strict=True)):
            return []
    return [
        Quantity(
            effect.joint,
            f"{effect.name()}.{parameter.name}" if several else effect.name(),
            convert_hinge_unit(parameter.unit, slide),
            float(getattr(effect, parameter.name)),
            intervals.get((effect.name(), effect.joint, parameter.name)),
        )
        for parameter in effect.free_parameters
    ]


def _replace_parameter(effects: Sequence[Effect], place: int, parameter: Parameter, value: float) -> list[Effect]:
    """Return effects with one parameter changed, clipped to its bounds."""
    lowest, highest = min(parameter.neutral, parameter.low), max(parameter.neutral, parameter.high)
    effect = effects[place]
    numbers = {each.name: getattr(effect, each.name) for each in effect.parameters}
    changed = make_effect(effect.name(), effect.joint, numbers | {parameter.name: min(max(value, lowest), highest)})
    return [*effects[:place], changed, *effects[place + 1 :]]
