"""Show a gap report: pictures and one page, from its two files alone."""

from pathlib import Path

from nas_data.gap.report import REPORT, GapReport
from nas_data.gap.showing.page import build
from nas_data.gap.showing.series import Series
from nas_data.whole_file import write_whole

PAGE, FIGURES = "report.html", "figures"


def show(folder: Path) -> Path:
    """Write the pictures and the page.

    Args:
        folder: Holds `report.json` and `series.npz`.

    Returns:
        The page.

    Raises:
        OptionError: one of the two files is missing or lacks a part.
    """
    page = build(GapReport.read(folder / REPORT), Series.read(folder))
    pictures = {f"{picture.name}.png": picture.png for picture in page.pictures()}
    for stale in (folder / FIGURES).glob("*.png"):
        if stale.name not in pictures:
            stale.unlink()
    for name, png in pictures.items():
        write_whole(folder / FIGURES / name, png)
    path = folder / PAGE
    write_whole(path, page.to_html().encode())
    return path
