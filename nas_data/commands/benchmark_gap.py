"""Hide effects in plants of other makes and grade what `nas gap` says about them."""

from dataclasses import dataclass
from pathlib import Path

from nas_data.commands.base import Command, CommandResult
from nas_data.runs.progress import say


@dataclass(frozen=True, kw_only=True)
class BenchmarkGap(Command):
    """Draw blind cases, run the gap workflow on each, and compare its report with the sealed answers.

    A finished case is never done again: the same command goes on where it was interrupted. Cases that other code of
    nas_data judged are refused.

    Example: nas benchmark gap --families one,outside --plants numpy,bullet --cases 5 --out runs/blind
    """

    families: str = "one,two,three,none,outside"
    """What hides: one, two or three effects, none, every (one effect in every joint), or something outside the
    catalogue; with commas."""
    plants: str = "numpy,bullet"
    """What plays the robot: numpy, bullet, or mujoco for comparison; with commas."""
    cases: int = 40
    """Cases of each family on each plant."""
    seed: int = 0
    """Master seed: same seed, same cases."""
    out: Path = Path("runs/blind")
    """Folder of the results and the cases."""
    setting: str = "xl320"
    """What the cases look like: xl320 (one size, rate and resolution), any (2 to 7 joints of any size and rate), poor
    (the same, in five episodes at 20 Hz), far (models with 3 to 50 times the true gain), torque (1 to 3 axes that turn
    or slide, commanded by torques, episodes that begin in motion), or small (two joints, a few short episodes)."""
    power: bool = False
    """Hide effects from 0.3 noise floors upwards, to see which size is found."""
    baselines: str = ""
    """Other methods that are given the same cases: sysid, one_step, phi; with commas."""
    keep: bool = False
    """Keep the datasets of finished cases."""

    def run(self) -> CommandResult:
        """Run what is not finished, then tabulate everything."""
        from nas_data.benchmarks.blind.benchmark import BlindPlan, run
        from nas_data.benchmarks.blind.tables import make_tables, print_tables
        from nas_data.runs.environment_info import find_commit

        families, plants, baselines = (split_words(text) for text in (self.families, self.plants, self.baselines))
        plan = BlindPlan(families, plants, self.cases, self.seed, self.power, baselines, self.keep, self.setting)
        records = run(plan, self.out, investigate, say)
        found = make_tables(records)
        text = f"{len(records)} blind cases ({self.setting}), seed {self.seed}\n\n{print_tables(found)}\n→ {self.out}"
        told = {
            "out": self.out,
            "cases": len(records),
            "setting": self.setting,
            "seed": self.seed,
            "commit": find_commit(),
        }
        return CommandResult(text, {**told, "tables": found})


def investigate(dataset: Path, model: Path, out: Path) -> None:
    """Run the workflow under test as its users do."""
    from nas_data.gap import workflow

    workflow.investigate(dataset, model, out)


def split_words(text: str) -> tuple[str, ...]:
    """Split a list with commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())
