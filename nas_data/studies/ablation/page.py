"""HTML page of a sweep: the sufficient amount of data, errors over the amount, and a table."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nas_data.reports.charts import Trace, make_axis, make_band, make_line, make_log_axis
from nas_data.reports.page import Block, Chart, HtmlPage, HtmlTable, PageSection, Text
from nas_data.reports.style import Stroke, choose_strokes
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.summary import JSON, Cell, SweepSummary
from nas_data.studies.ablation.write import HEADERS, make_rows

AXIS_MARGIN = 1.05  # margin factor of the axis of amounts
TITLES = {"open_loop": "open loop", "one_step": "one step"}


def read_page(folder: Path) -> HtmlPage:
    """Return the page of a sweep's folder.

    Raises:
        OptionError: its `ablation.json` is damaged.
    """
    return build(SweepSummary.read(folder / JSON), folder.name)


def build(summary: SweepSummary, name: str) -> HtmlPage:
    """Return the page of a sweep with a name."""
    drawn: list[Block] = [make_errors_chart(summary, loop) for loop in TITLES] if summary.cells else []
    what = (
        f"Position RMSE on held-out episodes, mean of the episodes [{summary.shown.mark.strip()}]; spread over seeds."
    )
    sections = [
        PageSection("", [Text(summary.sentence(), lead=True)]),
        PageSection("Error over the amount of data", drawn),
        PageSection("Every amount", [HtmlTable(HEADERS, make_rows(summary), what)]),
        PageSection("Failed trials", [Text(sentence) for sentence in summary.failed]),
    ]
    return HtmlPage(f"Sweep of the amount of data: {name}", [section for section in sections if section.blocks])


def make_errors_chart(summary: SweepSummary, loop: str) -> Chart:
    """Return the errors of each kind over the amount of data, with the baselines as horizontal lines."""
    labels = {kind: find_kind(kind).label for kind in summary.cells}
    looks = choose_strokes([*labels.values(), *summary.baselines])
    traces = [
        trace
        for kind, cells in summary.cells.items()
        for trace in make_curve(cells, loop, labels[kind], looks[labels[kind]], summary.shown.factor)
    ]
    amounts = sorted({cell.size for cells in summary.cells.values() for cell in cells})
    ends = np.array([amounts[0] / AXIS_MARGIN, amounts[-1] * AXIS_MARGIN])
    across = {name: summary.shown.factor * both[loop].median for name, both in summary.baselines.items()}
    traces += [
        make_line(ends, np.full(2, value), name, looks[name]) for name, value in across.items() if 0 < value < np.inf
    ]
    layout = {
        "xaxis": make_axis(
            f"{summary.unit} of training data", type="log", tickvals=amounts, ticktext=[f"{a:.3g}" for a in amounts]
        ),
        "yaxis": make_log_axis(f"position error, {TITLES[loop]} [{summary.shown.mark.strip()}]"),
    }
    caption = (
        f"Held-out error, {TITLES[loop]}: median over seeds, and a band from the lowest to the highest. Horizontal "
        "lines are baselines without learning: the simulator as given (source), the first position (hold), the command "
        "(command). "
        "Where a seed diverged there is no band."
    )
    return Chart(loop, caption, traces, layout, height=440)


def make_curve(cells: Sequence[Cell], loop: str, name: str, look: Stroke, factor: float) -> list[Trace]:
    """Return a kind's median error over the amounts, with a band from minimum to maximum."""
    sizes = np.array([cell.size for cell in cells])
    spreads = [cell.errors[loop] for cell in cells]
    rows = factor * np.array([(spread.ends[0], spread.median, spread.ends[1]) for spread in spreads]).T
    low, middle, high = np.where(np.isfinite(rows), rows, np.nan)
    return [*make_band(sizes, low, high, name, look), make_line(sizes, middle, name, look, mode="lines+markers")]
