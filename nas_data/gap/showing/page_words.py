"""How numbers and names of a gap report are said in plain words."""

import math
from collections.abc import Sequence
from typing import Literal

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
ANGLE = "rad"  # the unit of errors where a report does not say
ENDS: tuple[Literal["heldout_error_before"], Literal["heldout_error_after"]] = (
    "heldout_error_before",
    "heldout_error_after",
)
SURE, LIKELY = 0.9, 0.7  # confidences from which a name is called sure, and likely
CERTAIN = 0.99  # confidence beyond which no digit means anything


def figures(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, never in powers of ten for what is met here."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}"
    return text if places <= 7 else f"{value:.{digits - 1}e}"


def friendly(value: float, unit: str) -> str:
    """Return a value [SI] in the unit that people think in."""
    name, scale = FRIENDLY.get(unit, (f" {unit}" if unit else "", 1.0))
    return figures(value * scale) + name


def beside(value: float, unit: str) -> str:
    """Return a value in the unit that people think in, with the SI value behind it where that is another."""
    plain = f" ({figures(value)} {unit})" if unit in FRIENDLY else ""
    return friendly(value, unit) + plain


def interval(number: FittedParameter) -> str:
    """Return the 95 % interval of a parameter, empty where there is none."""
    ends = number.interval95
    if not ends or ends[0] == ends[1]:
        return ""
    return f"{friendly(ends[0], number.unit)} … {friendly(ends[1], number.unit)}"


def spoken(name: str) -> str:
    """Return an identifier as words."""
    return name.replace("_", " ")


def effect_title(effect: EffectName) -> str:
    """Return an effect with its place, for example `backlash in m3`."""
    return f"{spoken(effect.name)} in {effect.joint}" if effect.joint else f"{spoken(effect.name)} (whole arm)"


def join_items(items: Sequence[str]) -> str:
    """Return items as a sentence lists them."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def capital(text: str) -> str:
    """Return a sentence that begins with a capital, whatever it begins with."""
    return text[:1].upper() + text[1:]


def confidence(value: float) -> str:
    """Return a confidence and how to take it."""
    word = "sure" if value >= SURE else "likely" if value >= LIKELY else "a guess, not more"
    percent = f"{100 * value:.0f} %" if value < CERTAIN else f"over {100 * CERTAIN:.0f} %"
    return f"{percent} ({word})"


def remarks(effect: NamedEffect) -> list[str]:
    """Return what else is known of a named effect: its rivals and its mark, a sentence each."""
    return [*rivals(effect), *signature(effect.name)]


def rivals(effect: NamedEffect) -> list[str]:
    """Return how far the alternatives are behind."""
    unit = effect.evidence.unit
    told = [f"{effect_title(other)} ({friendly(other.heldout_error_after, unit)})" for other in effect.alternatives]
    return [f"In its place, this error would be left by {join_items(told)}."] if told else []


def signature(name: str) -> list[str]:
    """Return by what an effect is known, nothing where the catalogue no longer holds it."""
    try:
        known = find_effect(name).signature
    except UnknownName:
        return []
    return [f"Its mark: {known[:1].lower()}{known[1:]}"] if known else []
