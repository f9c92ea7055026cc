"""Figures of experiments and ablations: trajectories, growing errors, returns, errors over the amount of data."""

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

FLOOR = 0.1  # [deg] below the resolution of usual servos; a logarithm needs some floor
QUARTILES = (0.25, 0.5, 0.75)
HEADROOM = 1.5  # times the largest finite error, where the axis of errors ends


def draw_trajectory(
    measured: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    command: np.ndarray | None,
    period: float,
    joint: str,
    unit: JointUnit = HINGE,
) -> Figure:
    """Draw one joint of one episode, and the predictors' errors below.

    Args:
        measured: Positions after each control step [rad; m], shape (T,).
        predicted: The same from each predictor's open-loop rollout.
        command: Commanded positions [rad; m], shape (T,); None where speeds or torques are commanded.
        period: Control period [s].
        joint: Its name.
        unit: In what its positions are shown.
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
    """Draw how errors grow over rollouts: median and quartiles over episodes.

    A band that reaches the upper edge and a line that ends have diverged in a quarter and in half of the episodes.

    Args:
        errors: Of each predictor, the RMS over joints [rad] at each step of each episode, each of shape (T,).
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

    Where episodes differ in length, each step counts those that reach it. An error that is no number is infinite: that
    rollout diverged.
    """
    longest = max(len(episode) for episode in episodes)
    padded = np.full((len(episodes), longest), np.nan)
    for row, episode in zip(padded, episodes, strict=True):
        row[: len(episode)] = np.where(np.isfinite(episode), episode, np.inf)
    lower, higher = (np.nanquantile(padded, QUARTILES, axis=0, method=side) for side in ("lower", "higher"))
    with np.errstate(invalid="ignore"):  # infinity beside a number
        between = np.nanquantile(padded, QUARTILES, axis=0)
    return np.where(lower == higher, lower, np.where(np.isinf(higher), np.inf, between))


def compute_joint_errors(predicted: np.ndarray, measured: np.ndarray, joints: int) -> np.ndarray:
    """Return the RMS position error over joints [rad] at each step, shape (T,), from states of shape (T, ≥n)."""
    return np.sqrt(np.square(predicted[:, :joints] - measured[:, :joints]).mean(axis=1))


OVER_MEDIANS = 2.0  # times the largest median or baseline: one seed that went astray must not squash all others
TITLES = {"open_loop": "open loop", "one_step": "one step"}


@dataclass(frozen=True)
class AblationCurve:
    """Errors of one predictor over K amounts of data."""

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
        curves: By `open_loop` and `one_step`, a curve of each predictor.
        baselines: Likewise, the error of what learns nothing.
        unit: What the amounts count.
        shown: How errors are shown.
    """
    looks = choose_strokes([*next(iter(curves.values())), *next(iter(baselines.values()))])
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.8))
        panels = figure.subplots(1, len(curves), squeeze=False)[0]
        for axes, (loop, predictors) in zip(panels, curves.items(), strict=True):
            for name, curve in predictors.items():
                draw_curve(axes, name, curve, looks[name], shown.factor)
            for name, error in baselines[loop].items():
                if np.isfinite(error) and error > 0:  # a line across: a baseline needs no data
                    axes.axhline(shown.factor * error, label=name, **looks[name].curve())
            label(axes, sorted({float(a) for curve in predictors.values() for a in curve.amounts}))
            axes.set_ylim(top=find_axis_top([*predictors.values()], [*baselines[loop].values()], shown.factor))
            axes.set_xlabel(f"{unit} of training data")
            axes.set_ylabel(f"position error, {TITLES[loop]} [{shown.mark.strip()}]")
        place_legend_above(figure, panels[0])
    return figure


def find_axis_top(curves: Sequence[AblationCurve], baselines: Sequence[float], scale: float) -> float | None:
    """Return where the vertical axis ends, as shown; None where nothing is finite."""
    drawn = np.concatenate([*(curve.median for curve in curves), baselines])
    seen = drawn[np.isfinite(drawn)]
    return OVER_MEDIANS * scale * float(seen.max()) if len(seen) and seen.max() > 0 else None


def draw_curve(axes: Axes, name: str, curve: AblationCurve, look: Stroke, scale: float) -> None:
    """Draw a predictor's median and the band between its extremes; where a seed diverged, there is no band."""
    low, median, high = (scale * np.where(np.isfinite(v), v, np.nan) for v in (curve.low, curve.median, curve.high))
    axes.fill_between(curve.amounts, low, high, **look.area())
    axes.plot(curve.amounts, median, label=name, marker="o", markersize=3.5, **look.curve(10))


def label(axes: Axes, amounts: Sequence[float]) -> None:
    """Give both axes logarithmic scales; the horizontal one is marked at the amounts that were tried."""
    axes.set_xscale("log")
    make_logarithmic(axes)
    margin = 1.05 * (amounts[-1] / amounts[0]) ** 0.05
    axes.set_xlim(amounts[0] / margin, amounts[-1] * margin)  # not from the curves, which may all have diverged
    axes.set_xticks(amounts, [f"{amount:.3g}" for amount in amounts])
    axes.xaxis.set_minor_formatter(NullFormatter())


AUTHORS_LABEL = "the authors, on their target"
AUTHORS_OFFSET = 0.28  # of a column's width: the authors' numbers stand right of ours
DOT_SPREAD = 0.16  # of a column's width: dots of equal returns stay apart
MAX_SPANS = 3.0  # times the span of the medians: what lies further off is drawn at the edge, not to squash the rest


@dataclass(frozen=True)
class Panel:
    """Returns on one environment."""

    title: str  # its name
    returns: Mapping[str, np.ndarray]  # of each method, one number a seed
    intervals: Mapping[str, Interval]  # of each method, the interval of the median
    authors: Mapping[str, Sequence[float]]  # what the authors found, of those methods that they have


def draw_returns_by_method(panels: Sequence[Panel], label: str, quick: bool) -> Figure:
    """Draw a panel an environment: a dot a seed, a bar at the median with its interval, diamonds for the authors'.

    Args:
        panels: What to draw.
        label: What a return is.
        quick: Whether to say that this is no result.
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
    """Return the lowest and highest return that are drawn at their place."""
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
    """Draw median returns over the number of trajectories, a band between their extremes, and the authors'.

    Args:
        counts: Numbers of trajectories, K of them.
        returns: By method, of each count a number a seed; K arrays of shape (seeds,).
        labels: What each method is called.
        ends: Median return of methods that need no recording, as lines across.
        authors: Mean and standard deviation by number of trajectories.
        quick: Whether to say that this is no result.
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
        axes.set_xlabel("recorded trajectories that were learned from")
        axes.set_ylabel("mean return on the target")
        place_legend_above(figure, axes, columns=4 if len(returns) == 1 else 3)
        warn(figure, quick)
    return figure


def warn(figure: Figure, quick: bool) -> None:
    """Write over a picture that it is no result, where it is none."""
    if quick:
        figure.text(0.5, 0.5, "quick: no result", ha="center", va="center", fontsize=30, color=GREY, alpha=0.3)
