"""The verdict of a gap report in plain sentences: what is missing, how much it shrinks the gap, what stays."""

import math
from collections.abc import Callable, Mapping
from typing import Literal

from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import GapErrors, Retuned, Unexplained
from nas_data.gap.showing.page_words import LIKELY, effect_title, figures, friendly, join_items


def lead(report: GapReport) -> str:
    """Return the verdict in one sentence."""
    return VERDICTS.get(report.verdict, other)(report)


def of_slides(report: GapReport) -> str:
    """Return the sentence about the slides of an arm that has hinges as well, else nothing: lengths are no angles."""
    gap = report.gap.slides
    if gap is None:
        return ""
    return (
        f"These are errors of the hinges; that of the slides goes from {error(gap, 'before')} to "
        f"{error(gap, 'after')}, beside a noise of {error(gap, 'noise_floor')}."
    )


def error(gap: GapErrors, name: Literal["before", "plain", "after", "noise_floor"]) -> str:
    """Return one of the errors of a gap, a dash where it is not known."""
    value: float | None = getattr(gap, name)
    return "–" if value is None else friendly(value, gap.unit)


def none(report: GapReport) -> str:
    """Say that there is no gap."""
    gap = report.gap
    return (
        f"Nothing is missing: on held-out episodes {model(report)} errs by {error(gap, 'before')}, which is "
        f"what the noise of the readings, {error(gap, 'noise_floor')}, lets one expect."
    )


def retuned_sentence(report: GapReport) -> str:
    """Say that numbers that the model has were off."""
    count = len(report.retuned)
    numbers = "one number that it already has" if count == 1 else f"{count} numbers that it already has"
    return (
        f"Nothing is missing: {model(report)} only needs {numbers} changed, by at most {widest(report):.0f} %, and the "
        f"error on held-out episodes {falls(report)}, close to the noise of the readings, "
        f"{error(report.gap, 'noise_floor')}."
    )


def explained_sentence(report: GapReport) -> str:
    """Say what is missing, and that this is all."""
    return (
        f"{missing(report)} the error on held-out episodes {falls(report)}, and what is left is close to the noise of "
        f"the readings, {error(report.gap, 'noise_floor')}."
    )


def partly_explained_sentence(report: GapReport) -> str:
    """Say what is missing, and that something else is, too."""
    return (
        f"{missing(report)} the error on held-out episodes {falls(report)}, but the noise of the readings is "
        f"{error(report.gap, 'noise_floor')}, so something else is missing, too{places(report)}."
    )


def unexplained_sentence(report: GapReport) -> str:
    """Say that no name fits."""
    gap = report.gap
    how = "when all its smooth parameters are fitted" if gap.delivered == "plain" else "when its own are retuned"
    return (
        f"Something is missing in {model(report)} that no effect in the catalogue explains{places(report)}: on "
        f"held-out episodes it errs by {error(gap, 'before')}, by {error(gap, 'after')} {how}, and the noise of the "
        f"readings is {error(gap, 'noise_floor')}."
    )


def other(report: GapReport) -> str:
    """Say what there is to say of a verdict that this page does not know."""
    return f"Verdict {report.verdict}: the error on held-out episodes {falls(report)}."


VERDICTS: Mapping[str, Callable[[GapReport], str]] = {
    "none": none,
    "retuned": retuned_sentence,
    "explained": explained_sentence,
    "partly_explained": partly_explained_sentence,
    "unexplained": unexplained_sentence,
}


def model(report: GapReport) -> str:
    """Return how the model is called."""
    return f"the model {report.model}" if report.model else "the model"


def missing(report: GapReport) -> str:
    """Return the beginning of a sentence, which names what is missing."""
    effects = [effect_title(effect) for effect in report.effects]
    doubt = "probably " if min(effect.confidence for effect in report.effects) < LIKELY else ""
    part = "in part " if report.verdict == "partly_explained" else ""
    added = "it" if len(effects) == 1 else "them"
    gap = f"The gap between {model(report)} and the recording"
    return f"{gap} {doubt}comes {part}from {join_items(effects)}: with {added},"


def falls(report: GapReport) -> str:
    """Return how the gap shrinks."""
    return f"falls from {error(report.gap, 'before')} to {error(report.gap, 'after')}"


def places(report: GapReport) -> str:
    """Return where a rest is, to end a sentence with."""
    joints = [rest.joint for rest in report.unexplained]
    return f", at {join_items(joints)}" if joints else ""


def widest(report: GapReport) -> float:
    """Return the largest change among the retuned numbers [%]."""
    return max((abs(100 * (entry.factor - 1)) for entry in report.retuned), default=0.0)


def rest(entry: Unexplained) -> str:
    """Return what is left at a joint."""
    ratio = figures(entry.ratio_to_noise, 2)
    return f"{entry.joint}: the error is still {ratio} times the noise; it goes with {entry.goes_with}."


def change(factor: Retuned) -> tuple[str, str, str]:
    """Return a row of the table of retuned numbers."""
    percent = 100 * (factor.factor - 1)
    joint, _, kind = factor.parameter.rpartition(".")
    sign = "+" if percent > 0 else "−"
    bound = ", on its bound" if factor.at_bound else ""
    return f"{joint} {kind}".strip(), figures(factor.factor), f"{sign}{abs(percent):.1f} %{bound}"


def by_size(factor: Retuned) -> float:
    """Return how large a change is, in either direction."""
    return -abs(math.log(factor.factor))


def score_basis(report: GapReport) -> str:
    """Return of what the errors called after are."""
    gap = report.gap
    alone = gap.after if gap.after_model_xml is None else gap.after_model_xml
    if friendly(alone, gap.unit) == error(gap, "after"):
        return "The errors called after were computed from model.xml, read back."
    return (
        f"The errors called after are those of the effects named, of which model.xml cannot hold all; it alone "
        f"leaves {friendly(alone, gap.unit)}."
    )
