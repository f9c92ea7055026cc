"""Find where model and recording disagree, name the missing effect, add it to the model, show the gap shrink."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import begin, say


@dataclass(frozen=True, kw_only=True)
class Gap(TakesModel):
    """Run find, name, add and show; write report.json, report.html, model.xml, effects.json and figures.

    Example: nas gap datasets/arm --model arm.xml --out runs/gap
    """

    dataset: tyro.conf.Positional[Path]
    """Recorded episodes; they need not be paired."""
    model: str
    """Model to correct: an MJCF or URDF file, or a robot's name."""
    out: Path
    """Folder of the report; an earlier report in it is replaced."""
    learn: int = 0
    """Train φ on the remaining gap with this many updates (minutes), and report its share; it is left out if it does
    not help on held-out episodes. 0 trains none."""
    baseline: Path | None = None
    """Earlier recording: what the model leaves unexplained there is subtracted from the same motion and counts as noise
    in others, so that only what has changed since is named. Give the model that `nas gap` wrote for it. By default all
    is named."""

    def run(self) -> CommandResult:
        """Run all stages."""
        from nas_data.api.gap import identify
        from nas_data.gap.summary import summarise

        begin("reading the recording")
        report = identify(
            self.dataset,
            self.model,
            out=self.out,
            learn=self.learn,
            baseline=self.baseline,
            actuators=self.actuators,
            progress=say,
        )
        return CommandResult(summarise(report, self.out), report.to_json())
