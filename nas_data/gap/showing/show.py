"""Output of figures and page of a gap report."""

import re
from pathlib import Path

from nas_data.atomic_file import write_atomic
from nas_data.gap.report import REPORT, GapReport
from nas_data.gap.showing.figures import draw_all_joints, draw_joint, find_joints_above
from nas_data.gap.showing.page import build_page
from nas_data.gap.showing.series import Series
from nas_data.reports.style import to_png

PAGE, FIGURES = "report.html", "figures"


def show(folder: Path) -> Path:
    """Write figures and page.

    Args:
        folder: Folder with `report.json` and `series.npz`, and usually `model.xml` and `model.diff`.

    Returns:
        Path of the page.

    Raises:
        OptionError: one of the first two files is missing or incomplete.
    """
    report, series = GapReport.read(folder / REPORT), Series.read(folder)
    figures = {"gap_per_joint.png": draw_all_joints(report, series)}
    for joint in find_joints_above(series):
        name = re.sub(r"[^\w.-]", "_", series.joints[joint])
        figures[f"joint_{name}.png"] = draw_joint(report, series, joint)
    for stale in (folder / FIGURES).glob("*.png"):
        if stale.name not in figures:
            stale.unlink()
    for name, figure in figures.items():
        write_atomic(folder / FIGURES / name, to_png(figure))
    path = folder / PAGE
    write_atomic(path, build_page(report, series, folder).to_html().encode())
    return path
