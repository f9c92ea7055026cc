"""Write one self-contained HTML page with the curves and tables of any runs."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import OptionError, OutputExists


@dataclass(frozen=True, kw_only=True)
class Report(Command):
    """Show how models and policies learned and how policies do on the target, from the folders of their runs.

    Example: nas report runs/delta-arm-seed0 runs/policy --out report.html
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `nas train`, `nas policy train`, a comparison or `nas demo` wrote, or folders around them."""
    out: Path = Path("report.html")
    """The page; an earlier page of ours is replaced."""

    def run(self) -> CommandResult:
        """Read the runs and write the page."""
        if not self.runs:
            raise OptionError("Name at least one run's folder; see: nas report --help.")
        from nas_data.reports.page import HtmlPage, is_ours
        from nas_data.reports.run_sections import models_section, policies_section
        from nas_data.reports.runs import find_runs
        from nas_data.whole_file import write_whole

        if self.out.is_dir() or (self.out.exists() and not is_ours(self.out)):
            raise OutputExists(f"{self.out} exists and is no page of ours; choose another --out.")
        found = find_runs(self.runs)
        sections = [models_section(found.models)] if found.models else []
        if found.policies:
            sections.append(policies_section(found.groups()))
        page = HtmlPage("Runs of nas_data", sections)
        write_whole(self.out, page.to_html().encode())
        counts = {"models": len(found.models), "policies": len(found.policies)}
        text = f"{counts['models']} models and {counts['policies']} policies → {self.out}"
        return CommandResult(text, {"page": self.out, **counts})
