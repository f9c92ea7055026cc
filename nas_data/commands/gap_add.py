"""Only add named effects to a model: write model.xml from effects.json and score it on held-out episodes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import Outcome


@dataclass(frozen=True, kw_only=True)
class GapAdd(TakesModel):
    """Write the model with the effects of an effects.json, and re-score it from the written file.

    Example: nas gap add datasets/arm --model arm.xml --effects runs/gap/effects.json --out runs/gap
    """

    dataset: tyro.conf.Positional[Path]
    """Recorded episodes by which the written model is judged."""
    model: str
    """The model as it is: an MJCF or URDF file, or a robot's name."""
    effects: Path
    """A gap report's folder, its effects.json (as `nas gap name` writes it) or its report.json, which is rounded."""
    out: Path
    """Folder for model.xml."""

    def run(self) -> Outcome:
        """Write and score."""
        from nas_data.gap.added import added
        from nas_data.gap.named import Named
        from nas_data.gap.place import check_model
        from nas_data.gap.problem import Problem
        from nas_data.gap.report import gap
        from nas_data.gap.search.final import Final
        from nas_data.joint_units import unit_named

        check_model(self.out, self.model)
        problem = Problem.load(self.dataset, self.actuated(self.model))
        named = Named.read(self.effects)
        final = Final(named.effects, named.retuned, ())
        self.out.mkdir(parents=True, exist_ok=True)
        outcome = added(problem, final, Final((), {}, ()), Final((), {}, ()), self.out)
        found = gap(problem.held, outcome)
        told = " and ".join(
            f"{unit_named(str(errors['unit'])).text(float(str(errors['before'])), 3)} before, "
            f"{unit_named(str(errors['unit'])).text(float(str(errors['after'])), 3)} after"
            for errors in (found, found.get("slides"))
            if isinstance(errors, Mapping)
        )
        text = (
            f"Open-loop position error on {len(problem.held.evidence)} held-out episodes: {told}, "
            f"from the written file.\n{outcome.model}"
        )
        return Outcome(text, {"model": outcome.model, "before": found["before"], "after": found["after"]})
