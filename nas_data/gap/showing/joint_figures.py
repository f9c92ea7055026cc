"""Figure of one joint as it moved: its worst held-out episode, and the errors below."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nas_data.gap.showing.figures import FLOOR, LOOKS, Models
from nas_data.gap.showing.series import Series
from nas_data.joint_units import joint_unit
from nas_data.reports.style import BLACK, LIGHT, STROKES, WIDTH, house_style, legend_above


def worst_episode(series: Series, joint: int) -> int:
    """Return which held-out episode the model as handed over predicts worst at a joint, as its place."""
    return int(series.squares(series.before)[:, joint].argmax())


def joint_motion(series: Series, models: Models, joint: int, torques: bool) -> Figure:
    """Draw one joint in the episode that the model as handed over predicts worst.

    Args:
        series: Held-out episodes.
        models: Predictions of each model, shape (E, T, n).
        joint: Its place.
        torques: Whether commands are torques, which are not drawn.
    """
    episode = worst_episode(series, joint)
    rows = series.counts[episode]
    unit = joint_unit(series.joints[joint], series.slides)
    time, measured = series.time[rows], unit.factor * series.measured[episode, rows, joint]
    with house_style():
        figure = Figure(figsize=(WIDTH, 5.0))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        if not torques:
            command = unit.factor * series.command[episode, rows, joint]
            draw(above, time, command, "command", steps=True)
        draw(above, time, measured, "measured")
        for name, predicted in models.items():
            values = unit.factor * predicted[episode, rows, joint]
            draw(above, time, values, name)
            draw(below, time, values - measured, name)
        floor = unit.factor * float(series.floor[joint])
        below.axhspan(-floor, floor, color=LIGHT, alpha=0.45, linewidth=0, zorder=0)
        below.axhline(0.0, color=BLACK, linewidth=0.8, zorder=1)
        above.set_ylabel(f"position of {series.joints[joint]} [{unit.mark.strip()}]")
        below.set_ylabel(f"error [{unit.mark.strip()}]")
        below.set_xlabel("time since the start of the episode [s]")
        below.set_xlim(0.0, time[-1])
        # the legend is made of the upper axes' curves; the band has no curve there
        above.fill_between([], [], color=LIGHT, alpha=0.45, linewidth=0, label=FLOOR)
        legend_above(figure, above)
    return figure


def draw(axes: Axes, time: np.ndarray, values: np.ndarray, name: str, steps: bool = False) -> None:
    """Draw one curve in its own look."""
    look = LOOKS.get(name) or STROKES[name]
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
