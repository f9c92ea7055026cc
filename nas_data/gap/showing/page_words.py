"""Formatting of numbers and names on the page of a gap report."""

import math
from collections.abc import Sequence
from typing import Literal

from nas_data.count_of import join_items
from nas_data.effects.base import find_effect
from nas_data.errors import UnknownName
from nas_data.gap.report_parts import EffectName, FittedParameter, NamedEffect

FRIENDLY = {
    "rad": ("°", 180 / math.pi),
    "rad/s": ("°/s", 180 / math.pi),
    "m": (" mm", 1e3),
    "m/s": (" mm/s", 1e3),
    "s": (" ms", 1e3),
    "kg": (" g", 1e3),
    "kg·m²": (" g·cm²", 1e7),
}
LARGE = 1e4  # in display units; from here on, the SI unit is easier to read
MOST_JOINTS = 4  # that a sentence lists by name
ROUNDING = 1e-12  # smaller numbers are rounding errors
ANGLE = "rad"  # the unit of errors where a report does not say
ENDS: tuple[Literal["heldout_error_before"], Literal["heldout_error_after"]] = (
    "heldout_error_before",
    "heldout_error_after",
)
SURE, LIKELY = 0.9, 0.7  # confidences above which a name is called sure, and likely
CERTAIN = 0.99  # confidence above which digits are not significant


def format_figures(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without exponent if possible."""
    if abs(value) < ROUNDING:
        return "0"
    if not math.isfinite(value):
        return f"{value:g}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}"
    return text if places <= 7 else f"{value:.{digits - 1}e}"


def format_value(value: float, unit: str) -> str:
    """Return a value [SI] in display units."""
    name, scale = FRIENDLY.get(unit, ("", 1.0))
    if not name or abs(value * scale) >= LARGE:
        name, scale = f" {unit}" if unit else "", 1.0
    return format_figures(value * scale) + name


def format_with_si(value: float, unit: str) -> str:
    """Return a value in display units, followed by the SI value if different."""
    shown, plain = format_value(value, unit), f"{format_figures(value)} {unit}"
    return f"{shown} ({plain})" if unit in FRIENDLY and shown != plain else shown


def format_interval(number: FittedParameter) -> str:
    """Return the 95 % interval of a parameter, empty without one."""
    ends = number.interval95
    if not ends or ends[0] == ends[1]:
        return ""
    return f"{format_value(ends[0], number.unit)} … {format_value(ends[1], number.unit)}"


def as_words(name: str) -> str:
    """Return an identifier as words."""
    return name.replace("_", " ")


def format_effect_title(effect: EffectName) -> str:
    """Return an effect with its joint, for example `backlash in m3`."""
    return f"{as_words(effect.name)} in {effect.joint}" if effect.joint else f"{as_words(effect.name)} (whole arm)"


def list_effects(effects: Sequence[NamedEffect]) -> str:
    """Return effects as a phrase, the joints of one effect together: `speed limit in m2 and m3; backlash in m3`."""
    joints: dict[str, list[str]] = {}
    for effect in effects:
        joints.setdefault(as_words(effect.name), []).append(effect.joint or "")
    told = [f"{name} in {list_joints(where)}" if where[0] else f"{name} (whole arm)" for name, where in joints.items()]
    return join_items(told) if len(told) == len(effects) else "; ".join(told)


def list_joints(joints: Sequence[str]) -> str:
    """Return joints as a phrase: their names, or their number if they are many."""
    return join_items(joints) if len(joints) <= MOST_JOINTS else f"{len(joints)} joints"


def capitalise(text: str) -> str:
    """Return a sentence with a capital first letter."""
    return text[:1].upper() + text[1:]


def format_confidence(value: float) -> str:
    """Return a confidence with its interpretation."""
    word = "sure" if value >= SURE else "likely" if value >= LIKELY else "a guess, not more"
    percent = f"{100 * value:.0f} %" if value < CERTAIN else f"over {100 * CERTAIN:.0f} %"
    return f"{percent} ({word})"


def list_remarks(effect: NamedEffect) -> list[str]:
    """Return sentences about an effect's alternatives and its typical sign."""
    return [*describe_alternatives(effect), *describe_signature(effect.name)]


def describe_alternatives(effect: NamedEffect) -> list[str]:
    """Return the errors of the alternatives."""
    unit = effect.evidence.unit
    told = [
        f"{format_effect_title(other)} ({format_value(other.heldout_error_after, unit)})"
        for other in effect.alternatives
    ]
    return [f"In its place, this error would be left by {join_items(told)}."] if told else []


def describe_signature(name: str) -> list[str]:
    """Return the typical sign of an effect, empty if the catalogue lacks it."""
    try:
        known = find_effect(name).signature
    except UnknownName:
        return []
    return [f"Its mark: {known[:1].lower()}{known[1:]}"] if known else []
