"""Figures of errors: of each joint, of each episode, over time, and what explains how much of them."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nas_data.gap.showing.series import Series
from nas_data.joint_units import JointUnit
from nas_data.reports.style import (
    BLACK,
    BLUE,
    GREEN,
    LIGHT,
    ORANGE,
    OTHERS,
    PURPLE,
    WIDTH,
    Stroke,
    house_style,
    legend_above,
)

BEFORE, RETUNED, PLAIN, AFTER, PLACEBO = "before", "retuned", "plain fit", "after", "placebo"
LOOKS = {
    BEFORE: Stroke(BLUE, "-", 1.6, 4),
    RETUNED: Stroke(PURPLE, "-.", 1.6, 5),
    PLAIN: Stroke(OTHERS[-1], ":", 1.8, 5),
    AFTER: Stroke(ORANGE, "-", 1.4, 7),
    PLACEBO: Stroke(GREEN, "--", 1.6, 6),
}
MARKERS = {BEFORE: "o", RETUNED: "s", PLAIN: "v", AFTER: "D", PLACEBO: "^"}
FLOOR = "noise floor"
WINDOW = 0.1  # [s] over which errors are averaged when drawn over time
NOTHING = 1 / 3  # of a joint's floor, below which its errors are drawn no lower
MARGIN = 0.04  # of what a logarithmic axis spans, above and below it, where that is much
MOST_LABELS = 30  # ticks with a name on one axis
MANY = 8  # names along an axis, or long ones, are turned

Models = Mapping[str, np.ndarray]


def per_joint(series: Series, models: Models) -> Figure:
    """Draw the held-out RMSE of each joint by each model, and the floor; hinges and slides have axes of their own."""
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.6))
        widths = [len(chosen) + 1 for _, chosen in series.kinds]
        parts = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
        for axes, (unit, chosen) in zip(parts, series.kinds, strict=True):
            draw_joints(axes, series, models, unit, chosen)
        legend_above(figure, parts[0])
    return figure


def draw_joints(axes: Axes, series: Series, models: Models, unit: JointUnit, chosen: np.ndarray) -> None:
    """Draw the errors of the joints of one kind."""
    places, names = np.arange(len(chosen)), [series.joints[joint] for joint in chosen]
    floor = unit.factor * series.floor[chosen]
    lowest = NOTHING * floor  # of a joint that never moved, which would stretch the axis down to rounding errors
    rows = {name: np.maximum(unit.factor * series.by_joint(made)[chosen], lowest) for name, made in models.items()}
    stacked = np.stack([*rows.values()])
    axes.vlines(places, stacked.min(0), stacked.max(0), color=LIGHT, linewidth=1.0, zorder=2)
    for name, values in rows.items():
        draw_dots(axes, name, places, values)
    axes.hlines(floor, places - 0.35, places + 0.35, color=BLACK, linewidth=1.4, label=FLOOR, zorder=3)
    axes.set_xticks(places, names, rotation=label_angle(series.joints), ha=label_anchor(series.joints, "right"))
    axes.set_xlim(-0.6, len(places) - 0.4)
    axes.grid(visible=False, axis="x")
    logarithmic(axes, f"RMSE on held-out episodes [{unit.mark.strip()}]", [stacked.min(), stacked.max(), *floor])


def per_episode(series: Series, models: Models) -> Figure:
    """Draw the error of each held-out episode by the first and by the last model."""
    first, *_, last = models
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.3))
        axes = figure.subplots()
        begin, end = (series.shown(series.by_episode(models[name])) for name in (first, last))
        places = np.arange(len(begin))
        axes.vlines(places, begin, end, color=LIGHT, linewidth=1.4, zorder=2)
        draw_dots(axes, first, places, begin)
        draw_dots(axes, last, places, end)
        floor = float(series.shown(np.array(series.overall_floor)))
        axes.axhline(floor, color=BLACK, linewidth=1.2, label=FLOOR, zorder=1)
        shown = places[:: -(-len(places) // MOST_LABELS)]
        axes.set_xticks(shown, [str(series.episodes[place]) for place in shown])
        axes.set_xlim(-0.6, len(places) - 0.4)
        axes.grid(visible=False, axis="x")
        axes.set_xlabel("held-out episode")
        logarithmic(axes, f"RMSE over {series.over}", [*begin, *end, floor])
        legend_above(figure, axes)
    return figure


def over_time(series: Series, models: Models) -> Figure:
    """Draw how errors go on from the start of an episode: median over episodes, band between the quartiles."""
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.5))
        axes = figure.subplots()
        drawn = []
        for name, predicted in models.items():
            rows = series.shown(series.in_time(predicted, WINDOW))
            low, middle, high = np.nanquantile(rows, [0.25, 0.5, 0.75], axis=0)
            look = LOOKS[name]
            axes.fill_between(series.time, low, high, color=look.colour, alpha=0.14, linewidth=0, zorder=look.order)
            axes.plot(
                series.time,
                middle,
                label=name,
                color=look.colour,
                linestyle=look.line,
                linewidth=look.width,
                zorder=look.order + 10,
            )
            drawn += [np.nanmin(low), np.nanmax(high)]
        floor = float(series.shown(np.array(series.overall_floor)))
        axes.axhline(floor, color=BLACK, linewidth=1.2, label=FLOOR, zorder=1)
        axes.set_xlim(0.0, series.time[-1])
        axes.set_xlabel("time since the start of an episode [s]")
        logarithmic(axes, f"RMS error over {series.over}", [*drawn, floor])
        legend_above(figure, axes)
    return figure


def shares_bar(parts: Mapping[str, float]) -> Figure:
    """Draw one bar of what explains how much.

    Args:
        parts: Shares of the squared gap above the noise, at least 0, by what they are; what is left comes last.
    """
    with house_style():
        figure = Figure(figsize=(WIDTH, 1.35))
        axes = figure.subplots()
        left = 0.0
        for number, (name, share) in enumerate(parts.items()):
            label, colour = (
                f"{name}: {100 * share:.1f} %",
                LIGHT if number == len(parts) - 1 else (ORANGE, GREEN)[number],
            )
            axes.barh([0], [100 * share], left=[left], height=0.6, color=colour, edgecolor="white", label=label)
            left += 100 * share
        axes.set_xlim(0.0, max(left, 1.0))
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.grid(visible=False)
        axes.set_xlabel("share of the squared gap above the noise [%]")
        legend_above(figure, axes)
    return figure


def draw_dots(axes: Axes, name: str, places: np.ndarray, values: np.ndarray) -> None:
    """Draw one model's errors."""
    axes.plot(
        places,
        values,
        marker=MARKERS[name],
        markersize=9 if name == RETUNED else 6,
        markerfacecolor="none" if name == RETUNED else None,  # it often lies about another
        linestyle="none",
        color=LOOKS[name].colour,
        label=name,
        zorder=LOOKS[name].order,
    )


def logarithmic(axes: Axes, label: str, values: Sequence[float]) -> None:
    """Make the vertical axis logarithmic, with plain numbers in it and a margin about the values."""
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


def label_angle(names: Sequence[str]) -> int:
    """Return by how many degrees the names along an axis are turned so that they don't overlap."""
    return 30 if sum(len(name) for name in names) > 45 or len(names) > MANY + 4 else 0


def label_anchor(names: Sequence[str], side: Literal["left", "right"]) -> Literal["left", "center", "right"]:
    """Return by which end names hang on their ticks: by one side where they are turned."""
    return side if label_angle(names) else "center"
