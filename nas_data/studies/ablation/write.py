"""Result files of a sweep: `ablation.json`, the table as text and Markdown, and the figure."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.joint_units import HINGE, JointUnit
from nas_data.reports.figures import AblationCurve, draw_error_over_amount
from nas_data.reports.style import to_png
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.summary import JSON, LOOPS, Cell, Spread, SweepSummary
from nas_data.text_table import format_markdown_table
from nas_data.text_table import format_table as align_table
from nas_data.typed_json import make_finite

HEADERS = ("predictor", "training data", "seeds", "open loop: median", "min … max", "one step: median", "min … max")


def make_rows(summary: SweepSummary) -> list[tuple[str, ...]]:
    """Return the rows of the table, errors in their display unit."""
    learned = [
        (
            find_kind(kind).label,
            cell.text,
            *format_cells(cell.errors["open_loop"], cell.errors["one_step"], summary.shown),
        )
        for kind, found in summary.cells.items()
        for cell in found
    ]
    alone = [
        (name, "", *format_cells(both["open_loop"], both["one_step"], summary.shown))
        for name, both in summary.baselines.items()
    ]
    return [*learned, *alone]


def format_cells(open_loop: Spread, one_step: Spread, unit: JointUnit) -> tuple[str, ...]:
    """Return the number of seeds, and median and extremes of both errors."""
    return (str(len(open_loop.values)), *format_median(open_loop, 3, unit), *format_median(one_step, 4, unit))


def format_median(spread: Spread, digits: int, unit: JointUnit) -> tuple[str, str]:
    """Return the median, and the extremes if they differ, in a unit."""
    low, high = (format_number(value, digits, unit) for value in spread.ends)
    return format_number(spread.median, digits, unit), "" if low == high else f"{low} … {high}"


def format_number(value: float, digits: int, unit: JointUnit) -> str:
    """Return an error as text in a unit."""
    return f"{unit.factor * value:.{digits}f}" if math.isfinite(value) else "diverged"


def format_table(summary: SweepSummary) -> str:
    """Return the table for a terminal."""
    title = f"Position RMSE on held-out episodes, mean of the episodes [{summary.shown.shown}]"
    return f"{title}\n{align_table(HEADERS, make_rows(summary))}"


def format_markdown(summary: SweepSummary) -> str:
    """Return the table and the findings of the sweep as Markdown."""
    what = "degrees" if summary.shown is HINGE else "millimetres"
    head = f"Position RMSE on held-out episodes, mean of the episodes, in {what}; spread over seeds."
    return "\n\n".join([head, format_markdown_table(HEADERS, make_rows(summary)), summary.sentence()]) + "\n"


TABLE, FIGURE = "ablation.md", "ablation.png"


def write(folder: Path, summary: SweepSummary, more: Mapping[str, object]) -> dict[str, Path]:
    """Write all files; the figure only if a trial succeeded.

    Returns:
        The files by kind.
    """
    files = {"result": folder / JSON, "table": folder / TABLE}
    content = make_finite({"schema": 1, **summary.to_json(), **more})
    write_atomic(files["result"], (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
    write_atomic(files["table"], format_markdown(summary).encode())
    if summary.cells:
        files["figure"] = folder / FIGURE
        write_atomic(files["figure"], draw_picture(summary))
    return files


def draw_picture(summary: SweepSummary) -> bytes:
    """Return the figure as a PNG."""
    curves = {
        loop: {find_kind(kind).label: make_curve(cells, loop) for kind, cells in summary.cells.items()}
        for loop in LOOPS
    }
    lines = {loop: {name: both[loop].median for name, both in summary.baselines.items()} for loop in LOOPS}
    return to_png(draw_error_over_amount(curves, lines, summary.unit, summary.shown))


def make_curve(cells: Sequence[Cell], loop: str) -> AblationCurve:
    """Return a kind's errors over its amounts."""
    spreads = [cell.errors[loop] for cell in cells]
    low, high = (np.array([spread.ends[end] for spread in spreads]) for end in (0, 1))
    median = np.array([spread.median for spread in spreads])
    return AblationCurve(np.array([cell.size for cell in cells]), low, median, high)
