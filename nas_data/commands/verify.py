"""Check a dataset: files, rows, values, clock, provenance."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Verify(Command):
    """Check a dataset and report each problem in one sentence.

    Exit code: 0 if the dataset is valid, 1 if not, 2 if there is none.

    Example: nas verify datasets/ergojr_sample
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset, or datasets/NAME for its newest version."""

    def run(self) -> CommandResult:
        """Run every check."""
        from nas_data.dataset.verify import examine
        from nas_data.dataset.versions import resolve

        root = resolve(self.dataset)
        begin(f"checking {root}")
        findings = examine(root)
        verdict = "is valid" if not findings.problems else f"has {count_of(len(findings.problems), 'problem')}"
        lines = [
            f"{root} {verdict}.",
            *(f"  problem: {problem}" for problem in findings.problems),
            *(f"  note: {note}" for note in findings.notes),
        ]
        data = {"dataset": root, "sound": not findings.problems}
        return CommandResult(
            "\n".join(lines), data | {"problems": findings.problems, "notes": findings.notes}, not findings.problems
        )
