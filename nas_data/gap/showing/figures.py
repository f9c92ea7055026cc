"""Figures of a gap report for files and notebooks."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nas_data.gap.report import GapReport
from nas_data.gap.showing.series import Series
from nas_data.joint_units import JointUnit, find_joint_unit
from nas_data.reports import style

BEFORE, RETUNED, PLAIN, AFTER, PLACEBO = "before", "retuned", "plain fit", "after", "placebo"
LOOKS = {
    BEFORE: style.Stroke(style.BLUE, "-", 1.6, 4),
    RETUNED: style.Stroke(style.PURPLE, "-.", 1.6, 5),
    PLAIN: style.Stroke(style.OTHERS[-1], ":", 1.8, 5),
    AFTER: style.Stroke(style.ORANGE, "-", 1.4, 7),
    PLACEBO: style.Stroke(style.GREEN, "--", 1.6, 6),
}
MARKERS = {BEFORE: "o", RETUNED: "s", PLAIN: "v", AFTER: "D", PLACEBO: "^"}
FLOOR = "noise floor"
MARGIN = 0.04  # margin of a wide logarithmic axis, as a share of its logarithmic span
MANY = 8  # names along an axis above which they are rotated

ABOVE = 1.25  # noise floors above which a joint has a figure

Models = Mapping[str, np.ndarray]


def select_models(report: GapReport, series: Series) -> dict[str, np.ndarray]:
    """Return the predictions to draw; without named effects, the written model is the retuned one."""
    plain = {} if series.plain is None else {PLAIN: series.plain}
    if not report.effects:
        return {BEFORE: series.before, **plain, RETUNED: series.after}
    return {BEFORE: series.before, RETUNED: series.retuned, **plain, AFTER: series.after}


def select_joint_models(report: GapReport, series: Series) -> dict[str, np.ndarray]:
    """Return the predictions to draw for one joint: with the placebo, and without the retuned model beside names."""
    placebo = {} if series.placebo is None else {PLACEBO: series.placebo}
    shown = {**select_models(report, series), **placebo}
    return {name: values for name, values in shown.items() if name != RETUNED or not report.effects}


def find_joints_above(series: Series) -> list[int]:
    """Return the joints above the floor, largest gap first; the worst joint if there is none."""
    ratios = series.by_joint(series.before) / series.floor
    return [int(place) for place in np.argsort(-ratios) if ratios[place] > ABOVE] or [int(np.argmax(ratios))]


def has_torque_commands(report: GapReport) -> bool:
    """Whether commands are torques, so that the command is no prediction of the position."""
    joints = report.find.joints if report.find else {}
    return bool(joints) and all(gap.open_loop_command is None for gap in joints.values())


def draw_all_joints(report: GapReport, series: Series) -> Figure:
    """Draw the held-out error of each joint and model, and the noise floor."""
    return draw_error_per_joint(series, select_models(report, series))


def draw_joint(report: GapReport, series: Series, joint: int) -> Figure:
    """Draw one joint in its worst held-out episode."""
    return draw_joint_motion(series, select_joint_models(report, series), joint, has_torque_commands(report))


def draw_error_per_joint(series: Series, models: Models) -> Figure:
    """Draw the held-out RMSE of each joint and model, and the floor; hinges and slides have separate axes."""
    with style.house_style():
        figure = Figure(figsize=(style.WIDTH, 3.6))
        widths = [len(chosen) + 1 for _, chosen in series.kinds]
        parts = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
        for axes, (unit, chosen) in zip(parts, series.kinds, strict=True):
            draw_joints(axes, series, models, unit, chosen)
        style.place_legend_above(figure, parts[0])
    return figure


def draw_joints(axes: Axes, series: Series, models: Models, unit: JointUnit, chosen: np.ndarray) -> None:
    """Draw the errors of joints of one kind."""
    places, names = np.arange(len(chosen)), [series.joints[joint] for joint in chosen]
    floor = unit.factor * series.floor[chosen]
    rows = {name: unit.factor * series.drawn_by_joint(made)[chosen] for name, made in models.items()}
    stacked = np.stack([*rows.values()])
    axes.vlines(places, stacked.min(0), stacked.max(0), color=style.LIGHT, linewidth=1.0, zorder=2)
    for name, values in rows.items():
        draw_dots(axes, name, places, values)
    axes.hlines(floor, places - 0.35, places + 0.35, color=style.BLACK, linewidth=1.4, label=FLOOR, zorder=3)
    angle = choose_label_angle(series.joints)
    axes.set_xticks(places, names, rotation=angle, ha="right" if angle else "center")
    axes.set_xlim(-0.6, len(places) - 0.4)
    axes.grid(visible=False, axis="x")
    set_log_scale(axes, f"RMSE on held-out episodes [{unit.mark.strip()}]", [stacked.min(), stacked.max(), *floor])


def draw_dots(axes: Axes, name: str, places: np.ndarray, values: np.ndarray) -> None:
    """Draw one model's errors."""
    axes.plot(
        places,
        values,
        marker=MARKERS[name],
        markersize=9 if name == RETUNED else 6,
        markerfacecolor="none" if name == RETUNED else None,  # it often overlaps another
        linestyle="none",
        color=LOOKS[name].colour,
        label=name,
        zorder=LOOKS[name].order,
    )


def set_log_scale(axes: Axes, label: str, values: Sequence[float]) -> None:
    """Set a logarithmic vertical axis with plain numbers and a margin."""
    positive = [value for value in values if np.isfinite(value) and value > 0] or [1.0]
    axes.set_yscale("log")
    span = max(positive) / min(positive)
    margin = max(1.3, span**MARGIN)
    axes.set_ylim(min(positive) / margin, max(positive) * margin)
    axes.set_ylabel(label)
    wide = span > 30
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(
        lambda value, _: f"{value:g}" if f"{value:e}"[0] in ("25" if wide else "2357") else ""
    )


def choose_label_angle(names: Sequence[str]) -> int:
    """Return the rotation of names along an axis [°] so that they don't overlap."""
    return 30 if sum(len(name) for name in names) > 45 or len(names) > MANY + 4 else 0


def draw_joint_motion(series: Series, models: Models, joint: int, torques: bool) -> Figure:
    """Draw one joint in the episode with the largest error of the given model.

    Args:
        series: Held-out episodes.
        models: Predictions of each model [rad; m], shape (E, T, n).
        joint: Index of the joint.
        torques: Whether commands are torques, which are not drawn.
    """
    episode = series.worst_episode(joint)
    rows = series.counts[episode]
    unit = find_joint_unit(series.joints[joint], series.slides)
    time, measured = series.time[rows], unit.factor * series.measured[episode, rows, joint]
    with style.house_style():
        figure = Figure(figsize=(style.WIDTH, 5.0))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        if not torques:
            command = unit.factor * series.command[episode, rows, joint]
            draw_curve(above, time, command, "command", steps=True)
        draw_curve(above, time, measured, "measured")
        for name, predicted in models.items():
            values = unit.factor * predicted[episode, rows, joint]
            draw_curve(above, time, values, name)
            draw_curve(below, time, values - measured, name)
        floor = unit.factor * float(series.floor[joint])
        below.axhspan(-floor, floor, color=style.LIGHT, alpha=0.45, linewidth=0, zorder=0)
        below.axhline(0.0, color=style.BLACK, linewidth=0.8, zorder=1)
        above.set_ylabel(f"position of {series.joints[joint]} [{unit.mark.strip()}]")
        below.set_ylabel(f"error [{unit.mark.strip()}]")
        below.set_xlabel("time since the start of the episode [s]")
        below.set_xlim(0.0, time[-1])
        # an empty band adds the floor to the legend, which lists the upper axes
        above.fill_between([], [], color=style.LIGHT, alpha=0.45, linewidth=0, label=FLOOR)
        style.place_legend_above(figure, above)
    return figure


def draw_curve(axes: Axes, time: np.ndarray, values: np.ndarray, name: str, steps: bool = False) -> None:
    """Draw one curve in its style."""
    look = LOOKS.get(name) or style.STROKES[name]
    axes.plot(
        time,
        values,
        label=name,
        drawstyle="steps-pre" if steps else "default",
        color=look.colour,
        linestyle=look.line,
        linewidth=look.width,
        zorder=look.order,
    )
