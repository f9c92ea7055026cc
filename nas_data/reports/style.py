"""How every figure looks: one colour and stroke for each predictor and method, whichever figure it appears in."""

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
WIDTH = 7.6  # [in] 988 pixels: sharp at the 830 pixels that a README shows

# Okabe and Ito's palette, which people with any kind of colour vision can tell apart.
BLACK, GREY, LIGHT = "#000000", "#777777", "#999999"
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#E69F00", "#009E73", "#CC79A7"
VERMILION = "#D55E00"
OTHERS = (PURPLE, "#56B4E9", "#8C6D31")  # for what has no colour of its own, in order of appearance


@dataclass(frozen=True)
class Stroke:
    """How one predictor or method is drawn."""

    colour: str  # of line, band and dots
    line: str = "-"  # Matplotlib's line style, so that colour is not the only mark
    width: float = 1.8  # of the line [pt]
    order: int = 2  # lines with a higher order lie on top

    def curve(self, lift: int = 0) -> dict[str, Any]:
        """Return matplotlib's options of a curve, lifted in the drawing order."""
        order = self.order + lift
        return {"color": self.colour, "linestyle": self.line, "linewidth": self.width, "zorder": order}

    def area(self) -> dict[str, Any]:
        """Return matplotlib's options of an area."""
        return {"color": self.colour, "alpha": 0.16, "linewidth": 0, "zorder": self.order}


STROKES = {
    "measured": Stroke(BLACK, "-", 2.4, 3),
    "expert": Stroke(BLACK, "-", 1.8, 3),  # learned on what is measured
    "source": Stroke(BLUE, "-", 1.6, 4),
    "source + φ": Stroke(ORANGE, "-", 2.0, 6),
    "augmented": Stroke(ORANGE, "-", 2.0, 6),  # learned on source + φ
    "nas": Stroke(ORANGE, "-", 2.0, 6),  # the same, by the paper's name
    "ψ": Stroke(GREEN, "--", 1.6, 5),
    "forward": Stroke(GREEN, "--", 1.8, 5),  # learned on ψ
    "source + names": Stroke(VERMILION, "-.", 1.6, 5),
    "named": Stroke(VERMILION, "-.", 1.8, 5),  # learned on source + names
    "hold": Stroke(LIGHT, "-.", 1.2, 1),
    "command": Stroke(GREY, ":", 1.4, 1),
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw figures in the house style; matplotlib's own settings come back afterwards."""
    with matplotlib.style.context(RULES):
        yield


def choose_strokes(names: Sequence[str]) -> dict[str, Stroke]:
    """Return how each of some names is drawn; names without a stroke of their own get the spare colours in turn."""
    unknown = [name for name in names if name not in STROKES]
    spare = {name: Stroke(OTHERS[number % len(OTHERS)]) for number, name in enumerate(unknown)}
    return {name: STROKES.get(name) or spare[name] for name in names}


def make_logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")


def place_legend_above(figure: Figure, axes: Axes, columns: int = 6) -> None:
    """Put the legend of some axes above the figure, where it hides nothing, in so many columns at most."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=min(columns, len(labels)), handlelength=2.4)


def to_png(figure: Figure) -> bytes:
    """Return a figure as a PNG, the same bytes for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()
