"""Only name the missing effects: fit and compare candidates, and write effects.json."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import begin, say


@dataclass(frozen=True, kw_only=True)
class GapName(TakesModel):
    """Name the effects that the model lacks; write them and the retuned base parameters to effects.json.

    Example: nas gap name datasets/arm --model arm.xml --out runs/gap
    """

    dataset: tyro.conf.Positional[Path]
    """Recorded episodes."""
    model: str
    """Model to correct: an MJCF or URDF file, or a robot's name."""
    out: Path
    """Folder for effects.json."""

    def run(self) -> CommandResult:
        """Run the search and write its result."""
        from nas_data.gap.compose import describe_finding
        from nas_data.gap.name import name
        from nas_data.gap.output_folder import check_output_folder, refuse_finished_report
        from nas_data.gap.problem import Problem
        from nas_data.gap.summary import describe_effect
        from nas_data.gap.write_model import write_effects
        from nas_data.typed_json import to_json

        check_output_folder(self.out, self.model)
        refuse_finished_report(self.out)
        begin("reading the recording")
        problem = Problem.load(self.dataset, self.actuated(self.model))
        naming = name(problem.train, problem.held, say)
        nominal = problem.train.nominal
        self.out.mkdir(parents=True, exist_ok=True)
        path = write_effects(self.out, naming.final.effects, naming.final.factors, nominal)
        effects = [describe_finding(finding, nominal, finding.effect.in_model) for finding in naming.findings]
        lines = [describe_effect(effect) for effect in effects] or ["No effect is named."]
        return CommandResult("\n".join([*lines, str(path)]), {"effects": to_json(effects), "file": path})
