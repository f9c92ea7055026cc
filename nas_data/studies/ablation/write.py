"""Result files of a sweep: `ablation.json`, the table as Markdown, and the figure."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.reports.ablation_figure import AblationCurve, draw_error_over_amount
from nas_data.reports.style import to_png
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.summary import JSON, LOOPS, Cell, SweepSummary
from nas_data.studies.ablation.table import format_markdown
from nas_data.typed_json import make_finite

TABLE, FIGURE = "ablation.md", "ablation.png"


def write(folder: Path, summary: SweepSummary, more: Mapping[str, object]) -> dict[str, Path]:
    """Write all three; the figure only if a trial succeeded.

    Args:
        folder: Folder of the sweep.
        summary: Its summary.
        more: Further entries of the JSON file.

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
