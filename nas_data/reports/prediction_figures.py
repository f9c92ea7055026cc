"""Figures of predictors against measurements: one joint in time, and how errors grow over a rollout."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from nas_data.joint_units import HINGE, JointUnit
from nas_data.reports.style import WIDTH, choose_strokes, house_style, make_logarithmic, place_legend_above

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
