"""Figure of where the gap is: every joint under every condition, as a heat map."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from nas_data.gap.report import Bin
from nas_data.gap.showing.figures import label_anchor, label_angle
from nas_data.reports.style import WIDTH, house_style

COLOURS = "YlOrRd"
SHORTEST = 2.8  # [in] height in which the label of the scale finds room
DARK = 0.6  # part of the colour scale from which numbers are written in white
LEAST = 3.0  # noise floors at the dark end of the scale, at least: a small gap must not look like a large one


def regimes(bins: Sequence[Bin]) -> Figure:
    """Draw error over noise; a star marks what differs from the joint's other rows beyond chance."""
    joints = list(dict.fromkeys(entry.joint for entry in bins))
    places = list(dict.fromkeys((entry.regime, entry.bin) for entry in bins))
    ratios = np.full((len(places), len(joints)), np.nan)
    stars = np.zeros(ratios.shape, bool)
    for entry in bins:
        where = places.index((entry.regime, entry.bin)), joints.index(entry.joint)
        ratios[where], stars[where] = entry.ratio_to_noise, entry.significant
    with house_style():
        figure = Figure(figsize=(WIDTH, max(SHORTEST, 1.1 + 0.27 * len(places))))
        axes = figure.subplots()
        norm = LogNorm(1.0, max(LEAST, float(np.nanmax(ratios))))
        image = axes.imshow(np.clip(ratios, 1.0, None), norm=norm, cmap=COLOURS, aspect="auto")
        for row, column in np.argwhere(np.isfinite(ratios)):
            value = ratios[row, column]
            colour = "white" if norm(max(value, 1.0)) > DARK else "black"
            text = f"{value:.1f}" if value < 100 else f"{value:.0f}"
            mark = "*" if stars[row, column] else ""
            axes.text(column, row, text + mark, ha="center", va="center", fontsize=8, color=colour)
        axes.set_xticks(range(len(joints)), joints, rotation=label_angle(joints), ha=label_anchor(joints, "left"))
        axes.set_yticks(range(len(places)), [f"{regime}: {bin_}" for regime, bin_ in places])
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        for row in range(1, len(places)):
            if places[row][0] != places[row - 1][0]:
                axes.axhline(row - 0.5, color="white", linewidth=4)
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=40, label="error over the noise floor")
        bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        bar.ax.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
        bar.outline.set_visible(False)
    return figure
