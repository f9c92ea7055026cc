"""Table of a sweep: median and spread over seeds, with the baselines in the last rows."""

import math

from nas_data.joint_units import HINGE, JointUnit
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.summary import Spread, SweepSummary
from nas_data.text_table import format_markdown_table
from nas_data.text_table import format_table as align_table

HEADERS = ("learned", "from", "seeds", "open loop: median", "min … max", "one step: median", "min … max")


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
    """Return the table and what the sweep found as Markdown."""
    what = "degrees" if summary.shown is HINGE else "millimetres"
    head = f"Position RMSE on held-out episodes, mean of the episodes, in {what}; spread over seeds."
    return "\n\n".join([head, format_markdown_table(HEADERS, make_rows(summary)), summary.sentence()]) + "\n"
