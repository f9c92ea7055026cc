"""Only find where model and recording disagree: by joint and regime, after an audit of the recording."""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult


@dataclass(frozen=True, kw_only=True)
class GapFind(TakesModel):
    """Print the gap per joint and regime, the noise floor, and anomalies of the recording.

    Example: nas gap find datasets/arm --model arm.xml
    """

    dataset: tyro.conf.Positional[Path]
    """Recorded episodes; they need not be paired."""
    model: str
    """The model: an MJCF or URDF file, or a robot's name."""
    out: Path | None = None
    """Folder for find.json; nothing is written by default."""

    def run(self) -> CommandResult:
        """Compare recording and model, and print the findings."""
        from nas_data.atomic_file import write_atomic
        from nas_data.gap.problem import Problem
        from nas_data.gap.workflow import find_gap
        from nas_data.runs.progress import begin
        from nas_data.typed_json import make_finite

        begin("reading the recording")
        problem = Problem.load(self.dataset, self.actuated(self.model))
        begin("comparing model and recording")
        found = find_gap(problem)
        text = found.text()
        if self.out is not None:
            path = self.out / "find.json"
            write_atomic(path, json.dumps(make_finite(found.to_json()), indent=1).encode())
            text += f"\n{path}"
        return CommandResult(text, found.to_json())
