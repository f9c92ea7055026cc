"""The pictures of a gap report, each with a caption that says what it shows."""

import re

import numpy as np
from matplotlib.figure import Figure

from nas_data.gap.report import GapReport
from nas_data.gap.showing.figures import (
    AFTER,
    BEFORE,
    PLACEBO,
    PLAIN,
    RETUNED,
    over_time,
    per_episode,
    per_joint,
    shares_bar,
)
from nas_data.gap.showing.joint_figures import joint_motion, worst_episode
from nas_data.gap.showing.page_words import friendly, join_items
from nas_data.gap.showing.regime_figures import regimes
from nas_data.gap.showing.series import Series
from nas_data.joint_units import joint_unit
from nas_data.reports.page import Picture
from nas_data.reports.style import to_png

ABOVE = 1.25  # noise floors from which a joint's gap is worth a picture of its own


def models(report: GapReport, series: Series) -> dict[str, np.ndarray]:
    """Return the predictions that are drawn; without a named effect, the written model is the retuned one."""
    plain = {} if series.plain is None else {PLAIN: series.plain}
    if not report.effects:
        return {BEFORE: series.before, **plain, RETUNED: series.after}
    return {BEFORE: series.before, RETUNED: series.retuned, **plain, AFTER: series.after}


def with_placebo(report: GapReport, series: Series) -> dict[str, np.ndarray]:
    """Return the same with the placebo, where there is one."""
    return {**models(report, series), **({} if series.placebo is None else {PLACEBO: series.placebo})}


def legend(report: GapReport) -> str:
    """Return what the names in the legends mean."""
    parts = ["before: the model as handed over", "retuned: its own numbers fitted, nothing added"]
    parts += ["plain fit: every smooth parameter of every joint fitted, no name given"]
    return "; ".join(parts + (["after: with what is named added"] if report.effects else []))


def shrinking(report: GapReport, series: Series) -> list[Picture]:
    """Return the pictures of how the gap shrinks."""
    shown = with_placebo(report, series)
    return [
        gap_picture(report, series),
        *shares_picture(report),
        Picture(
            "episodes",
            to_png(per_episode(series, models(report, series))),
            f"Every one of the {len(series.episodes)} held-out episodes, before and after.",
        ),
        Picture(
            "error_over_time",
            to_png(over_time(series, shown)),
            "How the error goes on from the start of an episode: median over the held-out episodes, band from the "
            "lower to the upper quartile. Every episode is predicted from its first pose and its commands alone.",
        ),
    ]


def draw_all_joints(report: GapReport, series: Series) -> Figure:
    """Draw the held-out error of each joint by each model, beside the noise floor."""
    return per_joint(series, models(report, series))


def draw_joint(report: GapReport, series: Series, joint: int) -> Figure:
    """Draw one joint's worst held-out episode."""
    return joint_motion(series, shown_of_joint(report, series), joint, commands_torques(report))


def shown_of_joint(report: GapReport, series: Series) -> dict[str, np.ndarray]:
    """Return the predictions that are drawn of a joint."""
    return {name: values for name, values in with_placebo(report, series).items() if keeps(name, report)}


def gap_picture(report: GapReport, series: Series) -> Picture:
    """Return the picture of each joint's error by each model."""
    joints = to_png(draw_all_joints(report, series))
    return Picture("gap_per_joint", joints, f"Error of each joint on the held-out episodes. {legend(report)}.")


def shares_picture(report: GapReport) -> list[Picture]:
    """Return the bar of what explains how much, nothing where there was no gap to share."""
    shares = report.shares
    if report.verdict == "none" or not shares or shares.names is None:
        return []
    named = "named effects and retuning" if report.effects else "retuning"
    parts = {named: shares.names, "learned correction φ": shares.learned, "left": shares.left}
    known = {name: min(max(share, 0.0), 1.0) for name, share in parts.items() if share is not None}
    caption = "What explains the squared error above the noise, on the held-out episodes."
    return [Picture("shares", to_png(shares_bar(known)), caption)]


def joint_pictures(report: GapReport, series: Series) -> list[Picture]:
    """Return a picture of every joint with a gap; of the worst joint where none has one."""
    ratios = series.by_joint(series.before) / series.floor
    chosen = [int(place) for place in np.argsort(-ratios) if ratios[place] > ABOVE] or [int(np.argmax(ratios))]
    return [joint_picture(report, series, place) for place in chosen]


def joint_picture(report: GapReport, series: Series, joint: int) -> Picture:
    """Return a picture of one joint's worst held-out episode."""
    shown, name = shown_of_joint(report, series), series.joints[joint]
    figure = draw_joint(report, series, joint)
    unit = joint_unit(name, series.slides).si
    errors = join_items(
        [f"{label} {friendly(series.by_joint(values)[joint], unit)}" for label, values in shown.items()]
    )
    caption = (
        f"{name} in episode {series.episodes[worst_episode(series, joint)]}, which the model as handed over predicts "
        f"worst of the held-out ones. Over all of them the error of {name} is: {errors}."
    )
    return Picture("joint_" + re.sub(r"[^\w.-]", "_", name), to_png(figure), caption)


def keeps(name: str, report: GapReport) -> bool:
    """Whether a model is drawn in the pictures of joints: where effects are named, they are compared with nothing."""
    return name != RETUNED or not report.effects


def commands_torques(report: GapReport) -> bool:
    """Whether commands are torques: then there is no error of repeating them."""
    found = report.find
    return bool(found and found.joints) and all(
        gap.open_loop_command is None for gap in (found.joints if found else {}).values()
    )


def regimes_picture(report: GapReport) -> list[Picture]:
    """Return the heat map of joints and conditions, where there is one."""
    found = report.find
    if not found or not found.regimes:
        return []
    caption = (
        "Error of the model as handed over under each condition, in noise floors; 1 is perfect. A star marks what "
        "differs from the joint's other rows by more than chance."
    )
    return [Picture("regimes", to_png(regimes(found.regimes)), caption)]
