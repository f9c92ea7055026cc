"""Only add named effects to a model: write model.xml from effects.json and score it on held-out episodes."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import begin, say

if TYPE_CHECKING:
    from nas_data.gap.model_correction import ModelCorrection
    from nas_data.gap.nominal import Nominal


@dataclass(frozen=True, kw_only=True)
class GapAdd(TakesModel):
    """Write the model with the effects of an effects.json, and score the written file.

    Example: nas gap add datasets/arm --model arm.xml --effects runs/gap/effects.json --out runs/added
    """

    dataset: tyro.conf.Positional[Path]
    """Recorded episodes to score the written model on."""
    model: str
    """Model to correct: an MJCF or URDF file, or a robot's name."""
    effects: Path
    """A gap report's folder, its effects.json (as written by `nas gap name`) or its report.json, whose numbers are
    rounded."""
    out: Path
    """Folder for model.xml."""
    export: Literal["bam", "csv"] | None = None
    """Also write the identified parameters: bam/JOINT.json for Rhoban's BAM, or parameters.csv with gain, servo
    damping, armature, friction, delay, limits and mass of every joint, and ranges for domain randomisation."""

    def run(self) -> CommandResult:
        """Write the model and score it."""
        from nas_data.gap.compose import measure_gap
        from nas_data.gap.model_correction import ModelCorrection
        from nas_data.gap.output_folder import check_output_folder, refuse_finished_report
        from nas_data.gap.problem import Problem
        from nas_data.gap.score_model import score_model
        from nas_data.gap.search.final import FinalFit
        from nas_data.gap.windows import describe_windows
        from nas_data.joint_units import find_display_unit

        check_output_folder(self.out, self.model)
        refuse_finished_report(self.out)
        named = ModelCorrection.read(self.effects)
        begin("reading the recording")
        problem = Problem.load(self.dataset, self.actuated(self.model), registers=named.registers)
        named.check(problem.as_given.robot, problem.evidence.joints)
        begin("writing and evaluating the model")
        final = FinalFit(named.effects, named.retuned, ())
        self.out.mkdir(parents=True, exist_ok=True)
        outcome = score_model(problem, final, FinalFit((), {}, ()), FinalFit((), {}, ()), self.out)
        found = measure_gap(problem.held, outcome)
        shown = " and ".join(
            f"{unit.text(errors.before, 3)} before, {unit.text(errors.after, 3)} after"
            for errors in (found, found.slides)
            if errors is not None and (unit := find_display_unit(errors.unit))
        )
        text = (
            f"Open-loop position error on {describe_windows(problem.held.evidence.numbers, 'held-out')}: {shown}, "
            f"computed with the written file.\n{outcome.model}"
        )
        data: dict[str, object] = {"model": outcome.model, "before": found.before, "after": found.after}
        if self.export is not None:
            data["exported"] = self._export(problem.train.nominal, named)
            text += f"\n{data['exported']}"
        return CommandResult(text, data)

    def _export(self, nominal: "Nominal", named: "ModelCorrection") -> Path:
        """Write the parameters, and warn of what the format cannot hold."""
        from nas_data.gap.exporting.bam import write_bam
        from nas_data.gap.exporting.csv_table import write_table
        from nas_data.gap.exporting.identified import list_quantities, read_intervals

        intervals = read_intervals(self.effects, named.effects)
        quantities = list_quantities(nominal, named.effects, named.retuned, intervals)
        if self.export == "csv":
            path, lost = write_table(self.out, quantities)
        else:
            hinges = [joint for joint in nominal.joints if joint not in nominal.slides]
            path, lost = write_bam(self.out, hinges, quantities)
            lost += [f"{joint}, which is a slide" for joint in nominal.slides]
        for what in lost:
            say(f"nas: note: not in {path}: {what}")
        return path
