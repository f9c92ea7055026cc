"""Write one self-contained HTML page about runs, a gap, a sweep or a dataset."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError, OutputExists
from nas_data.runs.progress import begin

if TYPE_CHECKING:
    from nas_data.reports.page import HtmlPage

KINDS = {"models": "model", "policies": "policy", "gaps": "gap", "sweeps": "sweep", "datasets": "dataset"}


@dataclass(frozen=True, kw_only=True)
class Report(Command):
    """Show the contents of folders: trainings of models and policies, a gap, a sweep, a dataset.

    Example: nas report runs/delta-arm-seed0 runs/policy --out report.html
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN…")]
    """Folders written by `nas train`, `nas policy train`, a comparison or `nas demo`, or parents of such folders;
    folders written by `nas gap` or `nas ablate`; or datasets."""
    out: Path = Path("report.html")
    """Output page; an earlier page of `nas report` is replaced."""

    def run(self) -> CommandResult:
        """Read the folders and write the page."""
        if not self.runs:
            raise OptionError("Name at least one run's folder; see: nas report --help.")
        from nas_data.atomic_file import write_atomic
        from nas_data.reports.page import HtmlPage, PageSection, is_ours

        if self.out.is_dir() or (self.out.exists() and not is_ours(self.out)):
            raise OutputExists(f"{self.out} exists and was not written by nas report; choose another --out.")
        pages, counts = self.pages()
        page = pages[0]
        if len(pages) > 1:
            parts = [section for part in pages for section in (PageSection(part.title, []), *part.sections)]
            page = HtmlPage("Reports of nas_data", parts)
        write_atomic(self.out, page.to_html().encode())
        kinds = ", ".join(
            f"{number} {KINDS[kind] if number == 1 else kind}" for kind, number in counts.items() if number
        )
        return CommandResult(f"{kinds} → {self.out}", {"page": self.out, **counts})

    def pages(self) -> "tuple[list[HtmlPage], dict[str, int]]":
        """Return one page per gap, sweep and dataset, one for all runs, and the number of each kind."""
        from nas_data.reports.page import HtmlPage

        pages, runs, counts = [], [], dict.fromkeys(KINDS, 0)
        for path in self.runs:
            kind = find_kind(path)
            if kind == "runs":
                runs.append(path)
                continue
            begin(f"drawing {path}")
            pages.append(page_of(path, kind))
            counts[kind] += 1
        if runs:
            from nas_data.reports.run_sections import make_models_section, make_policies_section
            from nas_data.reports.runs import find_runs

            begin(f"drawing {count_of(len(runs), 'folder')} of runs")
            found = find_runs(runs)
            sections = [make_models_section(found.models)] if found.models else []
            sections += [make_policies_section(found.groups())] if found.policies else []
            pages.insert(0, HtmlPage("Runs of nas_data", sections))
            counts |= {"models": len(found.models), "policies": len(found.policies)}
        return pages, counts


def find_kind(path: Path) -> str:
    """Return the kind of a folder: `gaps`, `sweeps`, `datasets`, or else `runs`."""
    from nas_data.dataset.layout import INFO
    from nas_data.dataset.versions import list_versions

    if (path / "report.json").is_file():
        return "gaps"
    if (path / "ablation.json").is_file():
        return "sweeps"
    return "datasets" if (path / INFO).is_file() or list_versions(path) else "runs"


def page_of(path: Path, kind: str) -> "HtmlPage":
    """Return the page of a gap, a sweep or a dataset."""
    modules = {"gaps": "gap.showing.page", "sweeps": "studies.ablation.page", "datasets": "reports.dataset_page"}
    page: HtmlPage = import_module(f"nas_data.{modules[kind]}").read_page(path)
    return page
