"""Hide effects in independent simulators and grade what `nas gap` reports about them."""

from dataclasses import dataclass
from pathlib import Path

from nas_data.commands._long import LongCommand
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import say


@dataclass(frozen=True, kw_only=True)
class BenchmarkGap(LongCommand):
    """Draw blind cases, run the gap workflow on each, and compare its report with what was hidden.

    Finished cases are not repeated; the same command resumes an interrupted run. Cases of other versions of nas_data
    are refused.

    Example: nas benchmark gap --families one,outside --plants numpy,bullet --cases 5 --out runs/blind
    """

    families: str = "one,two,three,none,outside"
    """Hidden effects: one, two or three, none, every (one effect in every joint), outside (a cause that is not in the
    catalogue), or outside_one, outside_two (such a cause beside one or two of the catalogue); separated by commas."""
    plants: str = "numpy,bullet"
    """Simulators that stand in for the robot: numpy, bullet, or mujoco for comparison; separated by commas."""
    cases: int = 40
    """Cases of each family on each plant."""
    seed: int = 0
    """Master seed: same seed, same cases."""
    out: Path = Path("runs/blind")
    """Folder of the results and the cases."""
    setting: str = "xl320"
    """Kind of cases: xl320 (one size, rate and resolution), any (2 to 7 joints of any size and rate), poor (the same in
    five episodes at 20 Hz), far (models with 3 to 50 times the true gain), torque (1 to 3 torque-controlled hinges
    or slides, episodes that begin in motion), or small (two joints, a few short episodes)."""
    power: bool = False
    """Also hide effects as small as 0.3 noise floors, to measure from which size on they are found."""
    baselines: str = ""
    """Other methods to run on the same cases: sysid, one_step, phi; separated by commas. None by default."""
    keep: bool = False
    """Keep the datasets of finished cases, which are deleted by default."""

    def run(self) -> CommandResult:
        """Run the unfinished cases, then tabulate all."""
        from nas_data.benchmarks.blind.benchmark import BlindPlan, run
        from nas_data.benchmarks.blind.dry_run import plan_cases
        from nas_data.benchmarks.blind.tables import make_tables, print_tables
        from nas_data.runs.environment_info import find_commit

        families, plants, baselines = (split_words(text) for text in (self.families, self.plants, self.baselines))
        plan = BlindPlan(families, plants, self.cases, self.seed, self.power, baselines, self.keep, self.setting)
        workers = self.find_workers(self.out)
        if self.dry_run:
            return self.list_jobs(plan_cases(plan, self.out))
        records = run(plan, self.out, investigate, say, workers)
        found = make_tables(records)
        text = f"{len(records)} blind cases ({self.setting}), seed {self.seed}\n\n{print_tables(found)}\n→ {self.out}"
        settings = {
            "out": self.out,
            "cases": len(records),
            "setting": self.setting,
            "seed": self.seed,
            "commit": find_commit(),
        }
        return CommandResult(text, {**settings, "tables": found})


def investigate(dataset: Path, model: Path, out: Path) -> None:
    """Run the workflow under test as `nas gap` does."""
    from nas_data.gap import workflow

    workflow.investigate(dataset, model, out)


def split_words(text: str) -> tuple[str, ...]:
    """Split a comma-separated list."""
    return tuple(word.strip() for word in text.split(",") if word.strip())
