"""Style of all figures: the same colour and stroke for each predictor and method in every figure."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

RULES = Path(__file__).with_name("house.mplstyle")
DPI = 130
WIDTH = 7.6  # [in] 988 pixels, sharp at a README's width of 830 pixels

# Okabe and Ito's palette, distinguishable with any kind of colour vision.
BLACK, GREY, LIGHT = "#000000", "#777777", "#999999"
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#E69F00", "#009E73", "#CC79A7"
VERMILION = "#D55E00"
OTHERS = (PURPLE, "#56B4E9", "#8C6D31")  # colours for other names, in order of appearance


@dataclass(frozen=True)
class Stroke:
    """Style of one predictor or method."""

    colour: str  # of line, band and dots
    line: str = "-"  # Matplotlib's line style, so that colour is not the only difference
    width: float = 1.8  # of the line [pt]
    order: int = 2  # lines with a higher order are drawn on top

    def curve(self, lift: int = 0) -> dict[str, Any]:
        """Return Matplotlib's options of a curve; `lift` is added to the drawing order."""
        order = self.order + lift
        return {"color": self.colour, "linestyle": self.line, "linewidth": self.width, "zorder": order}

    def area(self) -> dict[str, Any]:
        """Return Matplotlib's options of an area."""
        return {"color": self.colour, "alpha": 0.16, "linewidth": 0, "zorder": self.order}


STROKES = {
    "measured": Stroke(BLACK, "-", 2.4, 3),
    "expert": Stroke(BLACK, "-", 1.8, 3),  # trained on the target
    "source": Stroke(BLUE, "-", 1.6, 4),
    "source + φ": Stroke(ORANGE, "-", 2.0, 6),
    "augmented": Stroke(ORANGE, "-", 2.0, 6),  # trained on source + φ
    "nas": Stroke(ORANGE, "-", 2.0, 6),  # the same, by the paper's name
    "ψ": Stroke(GREEN, "--", 1.6, 5),
    "forward": Stroke(GREEN, "--", 1.8, 5),  # trained on ψ
    "source + names": Stroke(VERMILION, "-.", 1.6, 5),
    "named": Stroke(VERMILION, "-.", 1.8, 5),  # trained on the source with named effects
    "hold": Stroke(LIGHT, "-.", 1.2, 1),
    "command": Stroke(GREY, ":", 1.4, 1),
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw figures in the house style; restore Matplotlib's settings afterwards."""
    with matplotlib.style.context(RULES):
        yield


def choose_strokes(names: Sequence[str]) -> dict[str, Stroke]:
    """Return the style of each name; names without a style of their own get the spare colours in turn."""
    unknown = [name for name in names if name not in STROKES]
    spare = {name: Stroke(OTHERS[number % len(OTHERS)]) for number, name in enumerate(unknown)}
    return {name: STROKES.get(name) or spare[name] for name in names}


def make_logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")


def place_legend_above(figure: Figure, axes: Axes, columns: int = 6) -> None:
    """Place the legend of some axes above the figure, with at most `columns` columns."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=min(columns, len(labels)), handlelength=2.4)


def to_png(figure: Figure) -> bytes:
    """Return a figure as a PNG; equal figures give equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()
