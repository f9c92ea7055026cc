"""Figures of the paper's experiments: returns by method, and return over the number of trajectories."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from nas_data.policies.intervals import Interval
from nas_data.reports.style import GREY, WIDTH, choose_strokes, house_style, place_legend_above

AUTHORS_LABEL = "the authors, on their target"
AUTHORS_OFFSET = 0.28  # of a column's width: the authors' numbers stand right of ours
DOT_SPREAD = 0.16  # of a column's width: dots of equal returns stay apart
MAX_SPANS = 3.0  # times the span of the medians: what lies further off is drawn at the edge, not to squash the rest


@dataclass(frozen=True)
class Panel:
    """Returns on one environment.

    Attributes:
        title: Its name.
        returns: Of each method, one number a seed.
        intervals: Of each method, the interval of the median.
        authors: What the authors found, of those methods that they have.
    """

    title: str
    returns: Mapping[str, np.ndarray]
    intervals: Mapping[str, Interval]
    authors: Mapping[str, Sequence[float]]


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
    """Draw median returns over the number of trajectories, with minimum, maximum and the authors' values.

    Args:
        counts: Numbers of trajectories, K of them.
        returns: Of each method, K arrays of shape (seeds,), one for each count.
        labels: What each method is called.
        ends: Median return of methods that need no recording, drawn as horizontal lines.
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
