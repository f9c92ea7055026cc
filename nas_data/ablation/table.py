"""The table of a sweep: median and spread over seeds, in degrees, the baselines below."""

import math
from collections.abc import Sequence

from nas_data.ablation.kinds.base import find_kind
from nas_data.ablation.summary import Spread, Summary
from nas_data.policies.tables import aligned

HEADERS = ("learned", "from", "seeds", "open loop: median", "min … max", "one step: median", "min … max")


def rows(summary: Summary) -> list[tuple[str, ...]]:
    """Return the rows of the table, errors in degrees."""
    learned = [
        (find_kind(kind).label, cell.text, *cells(cell.errors["open_loop"], cell.errors["one_step"]))
        for kind, found in summary.cells.items()
        for cell in found
    ]
    alone = [(name, "", *cells(both["open_loop"], both["one_step"])) for name, both in summary.baselines.items()]
    return [*learned, *alone]


def cells(open_loop: Spread, one_step: Spread) -> tuple[str, ...]:
    """Return seeds, then median and ends of both errors."""
    return (str(len(open_loop.values)), *told(open_loop, 3), *told(one_step, 4))


def told(spread: Spread, digits: int) -> tuple[str, str]:
    """Return the median, and the ends where they differ [deg]."""
    low, high = (degrees(value, digits) for value in spread.ends)
    return degrees(spread.median, digits), "" if low == high else f"{low} … {high}"


def degrees(value: float, digits: int) -> str:
    """Return an error [rad] as text in degrees."""
    return f"{math.degrees(value):.{digits}f}" if math.isfinite(value) else "diverged"


def text(summary: Summary) -> str:
    """Return the table for a terminal."""
    title = "Position RMSE on held-out episodes, mean of the episodes [deg]"
    return f"{title}\n{aligned(HEADERS, rows(summary))}"


def markdown(summary: Summary, notes: Sequence[str]) -> str:
    """Return the table and some sentences as Markdown."""
    lines = ["| " + " | ".join(row) + " |" for row in (HEADERS, ["---"] * len(HEADERS), *rows(summary))]
    head = "Position RMSE on held-out episodes, mean of the episodes, in degrees; spread over seeds."
    return "\n\n".join([head, "\n".join(lines), *notes]) + "\n"
