"""Figures of learning: policies over frames, their returns on the target, models over updates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nas_data.reports.style import WIDTH, Stroke, house_style, legend_above, strokes

SEED_SPREAD = 0.13  # of a row's height: dots of equal returns stay apart


@dataclass(frozen=True)
class LearningCurve:
    """How one seed of a method learned.

    Attributes:
        frames: Control steps so far, shape (K,).
        returns: Mean return of the episodes that ended since the row before, NaN where none did, shape (K,).
        success: Share of them that reached the goal, shape (K,).
    """

    frames: np.ndarray
    returns: np.ndarray
    success: np.ndarray


def learning(curves: Mapping[str, Sequence[LearningCurve]]) -> Figure:
    """Draw return and success while learning: median over seeds, band from the lowest to the highest.

    Args:
        curves: Of each method, one curve a seed.
    """
    looks = strokes(list(curves))
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.6))
        left, right = figure.subplots(1, 2)
        for method, seeds in curves.items():
            draw_band(left, method, seeds[0].frames, [seed.returns for seed in seeds], looks[method])
            draw_band(right, method, seeds[0].frames, [100 * seed.success for seed in seeds], looks[method])
        left.set_ylabel("return of an episode")
        right.set_ylabel("episodes that reach the goal [%]")
        right.set_ylim(-2.0, 102.0)
        for axes in (left, right):
            axes.set_xlabel("control steps learned from [thousand]")
            axes.margins(x=0.0)
        legend_above(figure, left)
    return figure


def draw_band(axes: Axes, name: str, frames: np.ndarray, seeds: Sequence[np.ndarray], look: Stroke) -> None:
    """Draw the median of several seeds, and a band between their extremes; unequal ends are cut to the shortest."""
    shortest = min(len(seed) for seed in seeds)
    values = np.stack([seed[:shortest] for seed in seeds])
    values = values[:, ~np.isnan(values).all(axis=0)]
    thousands = frames[:shortest][-values.shape[1] :] / 1000
    low, middle, high = np.nanmin(values, axis=0), np.nanmedian(values, axis=0), np.nanmax(values, axis=0)
    axes.fill_between(thousands, low, high, color=look.colour, alpha=0.16, linewidth=0)
    axes.plot(
        thousands, middle, label=name, color=look.colour, linestyle=look.line, linewidth=look.width, zorder=look.order
    )


def returns_on_target(returns: Mapping[str, np.ndarray]) -> Figure:
    """Draw every policy's mean return on the target: a row a method, a dot a seed, a stroke at the median.

    Args:
        returns: Of each method, one number a seed.
    """
    looks = strokes(list(returns))
    with house_style():
        figure = Figure(figsize=(WIDTH, 0.8 + 0.42 * len(returns)))
        axes = figure.subplots()
        for row, (method, values) in enumerate(returns.items()):
            look = looks[method]
            offsets = np.linspace(-SEED_SPREAD, SEED_SPREAD, len(values)) if len(values) > 1 else np.zeros(1)
            axes.scatter(values, row + offsets, s=34, color=look.colour, alpha=0.75, linewidth=0, zorder=4)
            middle = float(np.median(values))
            axes.plot([middle, middle], [row - 0.32, row + 0.32], color=look.colour, linewidth=2.6, zorder=5)
        for end in ("source", "expert"):
            if end in returns:
                axes.axvline(
                    float(np.median(returns[end])), color=looks[end].colour, linewidth=0.9, linestyle=":", zorder=1
                )
        axes.set_yticks(range(len(returns)), list(returns))
        axes.set_ylim(len(returns) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("mean return of an episode on the target")
    return figure


def model_training(histories: Mapping[str, Sequence[tuple[float, float]]], label: str) -> Figure:
    """Draw the validation error of models over their training.

    Args:
        histories: Of each model, updates done and validation error, one pair a validation.
        label: What the error is, with its unit.
    """
    looks = strokes(list(histories))
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.0))
        axes = figure.subplots()
        for name, history in histories.items():
            look = looks[name]
            updates, errors = np.array(history, dtype=float).reshape(-1, 2).T
            axes.plot(
                updates,
                errors,
                label=name,
                color=look.colour,
                linestyle=look.line,
                linewidth=look.width,
                marker="o",
                markersize=3,
            )
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(label)
        axes.set_xlabel("updates")
        legend_above(figure, axes)
    return figure
