"""Verdict, numbers and names of a gap report in words."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from nas_data.count_of import join_items
from nas_data.effects.base import find_effect
from nas_data.errors import UnknownName
from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import EffectName, FittedParameter, NamedEffect
from nas_data.gap.report_parts import GapErrors, Retuned, Unexplained
from nas_data.gap.summary import describe_open_joint, is_from_initial_states, is_retuned_far

FRIENDLY = {
    "rad": ("°", 180 / math.pi),
    "rad/s": ("°/s", 180 / math.pi),
    "m": (" mm", 1e3),
    "m/s": (" mm/s", 1e3),
    "s": (" ms", 1e3),
    "kg": (" g", 1e3),
    "kg·m²": (" g·cm²", 1e7),
}
NUMBER = re.compile(r"^-?[\d.]+(e[-+]\d+)?")
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
    """Return the 95 % interval of a parameter and its range over single episodes, empty without them."""
    interval, of_episodes = (format_range(ends, number.unit) for ends in (number.interval95, number.episode_range))
    return f"{interval}; single episodes {of_episodes}" if of_episodes else interval


def format_range(ends: tuple[float, float] | None, unit: str) -> str:
    """Return a range of values [SI] in display units; empty if it has no width."""
    if not ends or ends[0] == ends[1]:
        return ""
    low, high = (format_value(end, unit) for end in ends)
    unit = NUMBER.sub("", low)
    return f"{low.removesuffix(unit)} … {high}" if unit == NUMBER.sub("", high) else f"{low} … {high}"


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
    parts = [f"{name} in {list_joints(where)}" if where[0] else f"{name} (whole arm)" for name, where in joints.items()]
    return join_items(parts) if len(parts) == len(effects) else "; ".join(parts)


def list_joints(joints: Sequence[str]) -> str:
    """Return joints as a phrase: their names, or their number if they are many."""
    return join_items(joints) if len(joints) <= MOST_JOINTS else f"{len(joints)} joints"


def capitalise(text: str) -> str:
    """Return a sentence with a capital first letter."""
    return text[:1].upper() + text[1:]


def format_confidence(value: float) -> str:
    """Return a confidence with its interpretation."""
    word = "sure" if value >= SURE else "likely" if value >= LIKELY else "a guess"
    percent = f"{100 * value:.0f} %" if value < CERTAIN else f"over {100 * CERTAIN:.0f} %"
    return f"{percent} ({word})"


def list_remarks(effect: NamedEffect) -> list[str]:
    """Return sentences about an effect's alternatives and its typical sign."""
    return [*describe_alternatives(effect), *describe_doubt(effect), *describe_signature(effect.name)]


def describe_doubt(effect: NamedEffect) -> list[str]:
    """Return a sentence if the remaining error contradicts an effect that is the same in every posture."""
    if not effect.evidence.contradicts_constant:
        return []
    return ["The error that remains depends on the position, so the effect may not be constant."]


def describe_alternatives(effect: NamedEffect) -> list[str]:
    """Return the errors of the alternatives."""
    unit = effect.evidence.unit
    parts = [
        f"{format_effect_title(other)} ({format_value(other.heldout_error_after, unit)})"
        for other in effect.alternatives
    ]
    return [f"Error with another effect in its place: {join_items(parts)}."] if parts else []


def describe_signature(name: str) -> list[str]:
    """Return the typical sign of an effect, empty if the catalogue lacks it."""
    try:
        known = find_effect(name).signature
    except UnknownName:
        return []
    return [f"Its signature: {known[:1].lower()}{known[1:]}"] if known else []


def describe_verdict(report: GapReport) -> str:
    """Return the verdict in one sentence."""
    if report.verdict not in VERDICTS:
        return f"Verdict {report.verdict}: the error on held-out episodes {describe_drop(report)}."
    return VERDICTS[report.verdict](report)


def describe_slides(report: GapReport) -> str:
    """Return a sentence about the slides of an arm with hinges as well; else an empty string."""
    gap = report.gap.slides
    if gap is None:
        return ""
    return (
        f"These are errors of the hinges; that of the slides goes from {format_error(gap, 'before')} to "
        f"{format_error(gap, 'after')}, with a noise floor of {format_error(gap, 'noise_floor')}."
    )


def format_error(gap: GapErrors, name: Literal["before", "plain", "after", "noise_floor"]) -> str:
    """Return one of the errors of a gap, a dash if it is not known."""
    value: float | None = getattr(gap, name)
    return "–" if value is None else format_value(value, gap.unit)


def describe_none(report: GapReport) -> str:
    """Describe that there is no gap."""
    return (
        f"Nothing is missing: on held-out episodes {describe_model(report)} has an error of "
        f"{format_error(report.gap, 'before')}. {describe_explained_rest(report)}"
    )


def describe_retuned(report: GapReport) -> str:
    """Describe that parameters of the model were retuned."""
    count = len(report.retuned)
    largest = max((abs(100 * (entry.factor - 1)) for entry in report.retuned), default=0.0)  # [%]
    numbers = "one number that it already has" if count == 1 else f"{count} numbers that it already has"
    return (
        f"Nothing is missing: {describe_model(report)} only needs {numbers} changed, by at most "
        f"{largest:.0f} %, and the error on held-out episodes {describe_drop(report)}. "
        f"{describe_explained_rest(report)}"
    )


def describe_explained(report: GapReport) -> str:
    """Describe effects that explain the gap."""
    found = f"{describe_missing(report)} the error on held-out episodes {describe_drop(report)}."
    return f"{found} {describe_explained_rest(report)}"


def describe_explained_rest(report: GapReport) -> str:
    """Describe the rest of an explained gap."""
    noise = f"the noise of the readings, {format_error(report.gap, 'noise_floor')}"
    if is_from_initial_states(report):
        return (
            "What is left comes from the initial states: episodes begin in motion, in states estimated from noisy "
            f"readings. With these moved within their uncertainty, it is close to {noise}."
        )
    return f"What is left is close to {noise}."


def describe_partly_explained(report: GapReport) -> str:
    """Describe effects that explain a part of the gap."""
    gap = report.gap
    times = f"{format_figures(gap.after / gap.noise_floor, 2)} times" if gap.noise_floor else "above"
    return (
        f"{describe_missing(report)} the error on held-out episodes {describe_drop(report)}. That is still {times} "
        f"the noise of the readings, {format_error(gap, 'noise_floor')}{describe_places(report)}."
    )


def describe_unexplained(report: GapReport) -> str:
    """Describe a gap that no effect explains."""
    gap = report.gap
    if is_retuned_far(report):
        return (
            f"No effect in the catalogue explains what {describe_model(report)} lacks{describe_places(report)}: the "
            f"error on held-out episodes {describe_drop(report)} only if numbers that it already has change by more "
            f"than 25 %. {describe_explained_rest(report)}"
        )
    how = "when all its smooth parameters are fitted" if gap.delivered == "plain" else "when its own are retuned"
    is_undecided = report.experiments or not report.unexplained
    who = "this recording does not decide" if is_undecided else "no effect in the catalogue explains"
    return (
        f"Something is missing in {describe_model(report)} that {who}{describe_places(report)}: its error on held-out "
        f"episodes is {format_error(gap, 'before')}, {format_error(gap, 'after')} {how}, and the noise of the readings "
        f"is {format_error(gap, 'noise_floor')}."
    )


VERDICTS: Mapping[str, Callable[[GapReport], str]] = {
    "none": describe_none,
    "retuned": describe_retuned,
    "explained": describe_explained,
    "partly_explained": describe_partly_explained,
    "unexplained": describe_unexplained,
}


def describe_model(report: GapReport) -> str:
    """Return the name of the model in a sentence."""
    return f"the model {report.model}" if report.model else "the model"


def describe_missing(report: GapReport) -> str:
    """Return the beginning of a sentence with the missing effects."""
    doubt = "probably " if min(effect.confidence for effect in report.effects) < LIKELY else ""
    part = "in part " if report.verdict == "partly_explained" else ""
    added = "it" if len(report.effects) == 1 else "them"
    gap = f"The gap between {describe_model(report)} and the recording"
    return f"{gap} {doubt}comes {part}from {list_effects(report.effects)}: with {added},"


def describe_drop(report: GapReport) -> str:
    """Return the errors before and after, and what is subtracted from both."""
    drop = f"falls from {format_error(report.gap, 'before')} to {format_error(report.gap, 'after')}"
    return drop + report.gap.less


def describe_places(report: GapReport) -> str:
    """Return the unexplained joints at the end of a sentence."""
    joints = [rest.joint for rest in report.unexplained]
    return f", at {list_joints(joints)}" if joints else ""


def describe_rest(entry: Unexplained) -> str:
    """Return the remaining error of a joint."""
    if entry.is_at_floor:
        return f"{describe_open_joint(entry)}."
    ratio = format_figures(entry.ratio_to_noise, 2)
    return f"{entry.joint}: the error is still {ratio} times the noise; it correlates with {entry.goes_with}."


def make_retuned_row(factor: Retuned) -> tuple[str, str, str]:
    """Return a retuned parameter as a row."""
    percent = 100 * (factor.factor - 1)
    joint, _, kind = factor.parameter.rpartition(".")
    sign = "+" if percent > 0 else "−"
    bound = ", at its bound" if factor.at_bound else ""
    return f"{joint} {kind}".strip(), format_figures(factor.factor), f"{sign}{abs(percent):.1f} %{bound}"


def get_sort_key(factor: Retuned) -> float:
    """Return minus the size of a change, in either direction."""
    return -abs(math.log(factor.factor))


def describe_score_basis(report: GapReport) -> str:
    """Return the model to which errors called after belong."""
    gap = report.gap
    alone = gap.after if gap.after_model_xml is None else gap.after_model_xml
    if format_value(alone, gap.unit) == format_error(gap, "after"):
        return "Errors labelled 'after' were computed with the written model.xml."
    return (
        "Errors labelled 'after' are those of all named effects. model.xml cannot express all of them; its error is "
        f"{format_value(alone, gap.unit)}."
    )
