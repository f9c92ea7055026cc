"""The figure of an ablation: error over the amount of training data, the spread over seeds shaded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from nas_data.joint_units import HINGE, JointUnit
from nas_data.reports.style import WIDTH, Stroke, choose_strokes, house_style, make_logarithmic, place_legend_above

HEADROOM = 2.0  # times the largest median or baseline: one seed that went astray must not squash all others
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
    return HEADROOM * scale * float(seen.max()) if len(seen) and seen.max() > 0 else None


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
