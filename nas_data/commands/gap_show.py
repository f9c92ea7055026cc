"""Only show: redraw figures and page of a gap report from report.json and series.npz."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult


@dataclass(frozen=True, kw_only=True)
class GapShow(Command):
    """Draw the figures and write report.html from the files of `nas gap`.

    Example: nas gap show runs/gap
    """

    report: tyro.conf.Positional[Path]
    """Folder of a gap report."""

    def run(self) -> CommandResult:
        """Draw the figures and write the page."""
        from nas_data.errors import OptionError
        from nas_data.gap.showing.page import show

        if not (self.report / "report.json").is_file():
            what = f"no gap report in {self.report}" if self.report.exists() else f"no folder {self.report}"
            raise OptionError(
                f"There is {what}; give a gap report, or make one: nas gap DATASET --model MODEL.xml --out REPORT"
            )
        page = show(self.report)
        return CommandResult(f"{page}", {"page": page})
