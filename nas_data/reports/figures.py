"""Figures of experiments and ablations: trajectories, error growth, returns, errors against amount of data."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from nas_data.joint_units import HINGE, JointUnit
from nas_data.policies.intervals import Interval
from nas_data.reports.style import (
    GREY,
    WIDTH,
    Stroke,
    choose_strokes,
    house_style,
    make_logarithmic,
    place_legend_above,
)

FLOOR = 0.1  # [deg] lower end of logarithmic axes, below the resolution of usual servos
QUARTILES = (0.25, 0.5, 0.75)
HEADROOM = 1.5  # upper end of the error axis over the largest finite error


def draw_trajectory(
    measured: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    command: np.ndarray | None,
    period: float,
    joint: str,
    unit: JointUnit = HINGE,
) -> Figure:
    """Draw one joint in one episode, with the predictors' errors below.

    Args:
        measured: Positions after each control step [rad; m], shape (T,).
        predicted: Positions of each predictor's open-loop rollout [rad; m], shape (T,).
        command: Commanded positions [rad; m], shape (T,); None for speed or torque commands.
        period: Control period [s].
        joint: Name of the joint.
        unit: Display unit of its positions.
    """
    time = period * np.arange(1, len(measured) + 1)
    looks = choose_strokes([*predicted, "measured", "command"])
    with house_style():
        figure = Figure(figsize=(WIDTH, 4.6))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        curves = {"measured": measured, **predicted}
        if command is not None:
            curves["command"] = command
        for name, values in curves.items():
            drawn = "steps-pre" if name == "command" else "default"
            above.plot(time, unit.factor * values, label=name, drawstyle=drawn, **looks[name].curve())
            if name in predicted:
                below.plot(time, unit.factor * (values - measured), **looks[name].curve())
        below.axhline(0.0, color="black", linewidth=1.0)
        above.set_ylabel(f"position of {joint} [{unit.mark.strip()}]")
        below.set_ylabel(f"error [{unit.mark.strip()}]")
        below.set_xlabel("time since the start of the rollout [s]")
        below.set_xlim(0.0, time[-1])
        place_legend_above(figure, above)
    return figure


def draw_error_growth(errors: Mapping[str, Sequence[np.ndarray]], period: float) -> Figure:
    """Draw errors against time in rollouts: median and quartiles over episodes.

    A band at the upper edge means divergence in a quarter of the episodes, a line that ends in half of them.

    Args:
        errors: RMS over joints [rad] by predictor, one array of shape (T,) per episode.
        period: Control period [s].
    """
    looks = choose_strokes(list(errors))
    curves = {name: np.degrees(quartiles(episodes)).clip(FLOOR) for name, episodes in errors.items()}
    finite = np.concatenate([values[np.isfinite(values)] for values in curves.values()])
    edge = HEADROOM * float(finite.max(initial=FLOOR))
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.7))
        axes = figure.subplots()
        for name, (low, middle, high) in curves.items():
            time = period * np.arange(1, len(middle) + 1)
            axes.fill_between(time, low.clip(max=edge), high.clip(max=edge), **looks[name].area())
            axes.plot(time, middle, label=name, **looks[name].curve(10))
        make_logarithmic(axes)
        axes.set_ylim(FLOOR, edge)
        axes.set_ylabel("position error, RMS of joints [°]")
        axes.set_xlabel("time since the start of the rollout [s]")
        axes.set_xlim(0.0, period * max(len(episode) for episodes in errors.values() for episode in episodes))
        place_legend_above(figure, axes)
    return figure


def quartiles(episodes: Sequence[np.ndarray]) -> np.ndarray:
    """Return lower quartile, median and upper quartile over episodes at each step, shape (3, T).

    Each step includes the episodes that reach it. NaN counts as infinite, because that rollout diverged.
    """
    longest = max(len(episode) for episode in episodes)
    padded = np.full((len(episodes), longest), np.nan)
    for row, episode in zip(padded, episodes, strict=True):
        row[: len(episode)] = np.where(np.isfinite(episode), episode, np.inf)
    lower, higher = (np.nanquantile(padded, QUARTILES, axis=0, method=side) for side in ("lower", "higher"))
    with np.errstate(invalid="ignore"):  # infinity minus a number
        between = np.nanquantile(padded, QUARTILES, axis=0)
    return np.where(lower == higher, lower, np.where(np.isinf(higher), np.inf, between))


def compute_joint_errors(predicted: np.ndarray, measured: np.ndarray, joints: int) -> np.ndarray:
    """Return the RMS position error over joints [rad] at each step, shape (T,), from states of shape (T, ≥n)."""
    return np.sqrt(np.square(predicted[:, :joints] - measured[:, :joints]).mean(axis=1))


OVER_MEDIANS = 2.0  # largest drawn error over the largest median or baseline; outliers do not compress the axis
TITLES = {"open_loop": "open loop", "one_step": "one step"}


@dataclass(frozen=True)
class AblationCurve:
    """Errors of one predictor for K amounts of data."""

    amounts: np.ndarray  # shape (K,)
    low: np.ndarray  # smallest error of the seeds [rad], shape (K,); infinite where it diverged
    median: np.ndarray  # their median [rad], shape (K,)
    high: np.ndarray  # largest [rad], shape (K,)


def draw_error_over_amount(
    curves: Mapping[str, Mapping[str, AblationCurve]],
    baselines: Mapping[str, Mapping[str, float]],
    unit: str,
    shown: JointUnit = HINGE,
) -> Figure:
    """Draw open-loop and one-step errors side by side, both axes logarithmic; bands are cut at the top.

    Args:
        curves: Curve of each predictor, by `open_loop` and `one_step`.
        baselines: Error of each untrained predictor, by `open_loop` and `one_step`.
        unit: Unit of the amounts.
        shown: Display unit of errors.
    """
    looks = choose_strokes([*next(iter(curves.values())), *next(iter(baselines.values()))])
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.8))
        panels = figure.subplots(1, len(curves), squeeze=False)[0]
        for axes, (loop, predictors) in zip(panels, curves.items(), strict=True):
            for name, curve in predictors.items():
                draw_curve(axes, name, curve, looks[name], shown.factor)
            for name, error in baselines[loop].items():
                if np.isfinite(error) and error > 0:  # a horizontal line: baselines need no data
                    axes.axhline(shown.factor * error, label=name, **looks[name].curve())
            label(axes, sorted({float(a) for curve in predictors.values() for a in curve.amounts}))
            axes.set_ylim(top=find_axis_top([*predictors.values()], [*baselines[loop].values()], shown.factor))
            axes.set_xlabel(f"{unit} of training data")
            axes.set_ylabel(f"position error, {TITLES[loop]} [{shown.mark.strip()}]")
        place_legend_above(figure, panels[0])
    return figure


def find_axis_top(curves: Sequence[AblationCurve], baselines: Sequence[float], scale: float) -> float | None:
    """Return the upper end of the vertical axis in display units; None if no error is finite."""
    drawn = np.concatenate([*(curve.median for curve in curves), baselines])
    seen = drawn[np.isfinite(drawn)]
    return OVER_MEDIANS * scale * float(seen.max()) if len(seen) and seen.max() > 0 else None


def draw_curve(axes: Axes, name: str, curve: AblationCurve, look: Stroke, scale: float) -> None:
    """Draw a predictor's median and the band between its extremes; no band where a seed diverged."""
    low, median, high = (scale * np.where(np.isfinite(v), v, np.nan) for v in (curve.low, curve.median, curve.high))
    axes.fill_between(curve.amounts, low, high, **look.area())
    axes.plot(curve.amounts, median, label=name, marker="o", markersize=3.5, **look.curve(10))


def label(axes: Axes, amounts: Sequence[float]) -> None:
    """Set logarithmic scales on both axes; ticks of the horizontal one are the tried amounts."""
    axes.set_xscale("log")
    make_logarithmic(axes)
    margin = 1.05 * (amounts[-1] / amounts[0]) ** 0.05
    axes.set_xlim(amounts[0] / margin, amounts[-1] * margin)  # independent of the curves, which may all have diverged
    axes.set_xticks(amounts, [f"{amount:.3g}" for amount in amounts])
    axes.xaxis.set_minor_formatter(NullFormatter())


AUTHORS_LABEL = "the authors, on their target"
AUTHORS_OFFSET = 0.28  # offset of the authors' numbers to the right of ours, over a column's width
DOT_SPREAD = 0.16  # offset between dots of equal returns, over a column's width
MAX_SPANS = 3.0  # times the span of the medians; more distant values are drawn at the edge


@dataclass(frozen=True)
class Panel:
    """Returns in one environment."""

    title: str  # its name
    returns: Mapping[str, np.ndarray]  # returns of each method, one per seed
    intervals: Mapping[str, Interval]  # interval of the median of each method
    authors: Mapping[str, Sequence[float]]  # the authors' returns of each method, if published


def draw_returns_by_method(panels: Sequence[Panel], label: str, quick: bool) -> Figure:
    """Draw one panel per environment: dots for seeds, bars for medians with intervals, diamonds for the authors'.

    Args:
        panels: Returns of each environment.
        label: Label of the vertical axis.
        quick: Whether to mark the figure as no result.
    """
    with house_style():
        columns = min(len(panels), 2)
        rows = -(-len(panels) // columns)
        figure = Figure(figsize=(WIDTH, 3.4 * rows))
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for place, panel in zip(axes, panels, strict=False):
            draw_panel(place, panel)
        for place in axes[len(panels) :]:
            place.set_visible(False)
        axes[0].set_ylabel(label)
        warn(figure, quick)
    return figure


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw one environment."""
    looks = choose_strokes(list(panel.returns))
    low, high = find_drawn_range(panel)
    for column, (method, values) in enumerate(panel.returns.items()):
        colour = looks[method].colour
        offsets = np.linspace(-DOT_SPREAD, DOT_SPREAD, len(values)) if len(values) > 1 else np.zeros(1)
        axes.scatter(column + offsets, values.clip(low, high), s=26, color=colour, alpha=0.7, linewidth=0, zorder=4)
        middle = float(np.median(values))
        axes.plot([column - 0.34, column + 0.34], [middle, middle], color=colour, linewidth=2.4, zorder=5)
        ends = panel.intervals[method].low, panel.intervals[method].high
        axes.plot([column, column], np.clip(ends, low, high), color=colour, linewidth=1.2, zorder=3)
        theirs = np.array(panel.authors.get(method, ()))
        places = np.full(len(theirs), column + AUTHORS_OFFSET)
        axes.scatter(places, theirs.clip(low, high), s=18, marker="d", color="none", edgecolors=GREY, zorder=2)
    axes.set_ylim(low, high)
    axes.set_xticks(range(len(panel.returns)), list(panel.returns), rotation=35, ha="right")
    axes.grid(visible=False, axis="x")
    axes.set_title(f"{panel.title} (◇ {AUTHORS_LABEL})" if panel.authors else panel.title, fontsize=10)


def find_drawn_range(panel: Panel) -> tuple[float, float]:
    """Return the lowest and highest return of the vertical axis."""
    medians = np.array([float(np.median(values)) for values in panel.returns.values()])
    every = np.concatenate([*panel.returns.values(), *(np.array(v) for v in panel.authors.values())])
    span = max(float(np.ptp(medians)), 1e-6 + 0.05 * float(np.abs(medians).max()))
    low, high = max(float(every.min()), medians.min() - MAX_SPANS * span), float(every.max())
    margin = 0.06 * max(high - low, span)
    return low - margin, high + margin


def draw_return_over_count(
    counts: Sequence[int],
    returns: Mapping[str, Iterable[np.ndarray]],
    labels: Mapping[str, str],
    ends: Mapping[str, float],
    authors: Mapping[int, tuple[float, float]],
    quick: bool,
) -> Figure:
    """Draw median returns against number of trajectories, with a band between their extremes, and the authors'.

    Args:
        counts: Numbers of trajectories, K of them.
        returns: Returns by method; K arrays of shape (seeds,).
        labels: Names of the methods in the legend.
        ends: Median return of methods that need no recording, drawn as horizontal lines.
        authors: Mean and standard deviation by number of trajectories.
        quick: Whether to mark the figure as no result.
    """
    looks = choose_strokes([*returns, *ends])
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.6))
        axes = figure.subplots()
        for method, values in returns.items():
            look = looks[method]
            low, middle, high = ([function(seeds) for seeds in values] for function in (np.min, np.median, np.max))
            axes.fill_between(counts, low, high, color=look.colour, alpha=0.18, linewidth=0)
            axes.plot(
                counts, middle, color=look.colour, linestyle=look.line, marker="o", markersize=4, label=labels[method]
            )
        for name, value in ends.items():
            axes.axhline(value, color=looks[name].colour, linestyle=looks[name].line, linewidth=1.2, label=name)
        if authors:
            means, deviations = np.array(list(authors.values())).T
            axes.errorbar(
                list(authors), means, deviations, fmt="d", color=GREY, markersize=4, linewidth=1, label=AUTHORS_LABEL
            )
        axes.set_xscale("log")
        ticks = sorted({*counts, *authors})
        axes.set_xticks(ticks, [str(count) for count in ticks], fontsize=8)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("recorded trajectories for training")
        axes.set_ylabel("mean return on the target")
        place_legend_above(figure, axes, columns=4 if len(returns) == 1 else 3)
        warn(figure, quick)
    return figure


def warn(figure: Figure, quick: bool) -> None:
    """Mark a quick figure as no result."""
    if quick:
        figure.text(0.5, 0.5, "quick: no result", ha="center", va="center", fontsize=30, color=GREY, alpha=0.3)
