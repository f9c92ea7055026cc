"""Verdict of a gap report in sentences."""

import math
from collections.abc import Callable, Mapping
from typing import Literal

from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import GapErrors, Retuned, Unexplained
from nas_data.gap.showing.page_words import LIKELY, format_figures, format_value, list_effects, list_joints


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
        f"{format_error(gap, 'after')}, beside a noise of {format_error(gap, 'noise_floor')}."
    )


def format_error(gap: GapErrors, name: Literal["before", "plain", "after", "noise_floor"]) -> str:
    """Return one of the errors of a gap, a dash if it is not known."""
    value: float | None = getattr(gap, name)
    return "–" if value is None else format_value(value, gap.unit)


def describe_none(report: GapReport) -> str:
    """Describe that there is no gap."""
    gap = report.gap
    return (
        f"Nothing is missing: on held-out episodes {describe_model(report)} errs by {format_error(gap, 'before')}, "
        "which is "
        f"what the noise of the readings, {format_error(gap, 'noise_floor')}, lets one expect."
    )


def describe_retuned(report: GapReport) -> str:
    """Describe that parameters of the model were retuned."""
    count = len(report.retuned)
    largest = max((abs(100 * (entry.factor - 1)) for entry in report.retuned), default=0.0)  # [%]
    numbers = "one number that it already has" if count == 1 else f"{count} numbers that it already has"
    first = "No effect is named" if any(entry.is_large for entry in report.retuned) else "Nothing is missing"
    return (
        f"{first}: {describe_model(report)} only needs {numbers} changed, by at most "
        f"{largest:.0f} %, and the error on held-out episodes {describe_drop(report)}, close to the noise of the "
        f"readings, {format_error(report.gap, 'noise_floor')}."
    )


def describe_explained(report: GapReport) -> str:
    """Describe effects that explain the gap."""
    return (
        f"{describe_missing(report)} the error on held-out episodes {describe_drop(report)}, and what is left is "
        "close to the noise of "
        f"the readings, {format_error(report.gap, 'noise_floor')}."
    )


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
    how = "when all its smooth parameters are fitted" if gap.delivered == "plain" else "when its own are retuned"
    return (
        f"Something is missing in {describe_model(report)} that no effect in the catalogue "
        f"explains{describe_places(report)}: on "
        f"held-out episodes it errs by {format_error(gap, 'before')}, by {format_error(gap, 'after')} {how}, and the "
        "noise of the "
        f"readings is {format_error(gap, 'noise_floor')}."
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
    """Return the errors before and after."""
    return f"falls from {format_error(report.gap, 'before')} to {format_error(report.gap, 'after')}"


def describe_places(report: GapReport) -> str:
    """Return the unexplained joints at the end of a sentence."""
    joints = [rest.joint for rest in report.unexplained]
    return f", at {list_joints(joints)}" if joints else ""


def describe_rest(entry: Unexplained) -> str:
    """Return the remaining error of a joint."""
    ratio = format_figures(entry.ratio_to_noise, 2)
    return f"{entry.joint}: the error is still {ratio} times the noise; it goes with {entry.goes_with}."


def make_retuned_row(factor: Retuned) -> tuple[str, str, str]:
    """Return a retuned parameter as a row."""
    percent = 100 * (factor.factor - 1)
    joint, _, kind = factor.parameter.rpartition(".")
    sign = "+" if percent > 0 else "−"
    bound = ", on its bound" if factor.at_bound else ""
    return f"{joint} {kind}".strip(), format_figures(factor.factor), f"{sign}{abs(percent):.1f} %{bound}"


def get_sort_key(factor: Retuned) -> float:
    """Return minus the size of a change, in either direction."""
    return -abs(math.log(factor.factor))


def describe_score_basis(report: GapReport) -> str:
    """Return the model to which errors called after belong."""
    gap = report.gap
    alone = gap.after if gap.after_model_xml is None else gap.after_model_xml
    if format_value(alone, gap.unit) == format_error(gap, "after"):
        return "The errors called after were computed from model.xml, read back."
    return (
        f"The errors called after are those of the effects named, of which model.xml cannot hold all; it alone "
        f"leaves {format_value(alone, gap.unit)}."
    )
