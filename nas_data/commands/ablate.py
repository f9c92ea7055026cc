"""Accuracy of φ, ψ and named effects against amount of data: amount × seed × kind, in a table and a figure."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands._long import LongCommand
from nas_data.commands.base import CommandResult
from nas_data.errors import OptionError
from nas_data.runs.progress import say

if TYPE_CHECKING:
    from nas_data.models.presets import TrainingOptions
    from nas_data.studies.ablation.sweep import SweepPlan
    from nas_data.studies.ablation.sweep_data import Amount

DEFAULT_COUNTS = (10, 25, 50, 100, 250, 500, 1000)  # training episodes, up to the available number
QUICK = {"hidden": 32, "layers": 1, "updates": 40, "horizon": 60, "frames": 1600}  # a trial in seconds


@dataclass(frozen=True, kw_only=True)
class Ablate(TakesModel, LongCommand):
    """Train on nested subsets of a dataset, test on held-out episodes, and report how much data is enough.

    Finished trials are not repeated; the same command resumes an interrupted run. Trials of other versions of nas_data
    are kept, and run again.

    Example: nas ablate datasets/arm --counts 10,25,50,100 --seeds 0,1,2 --kinds delta,forward --workers 2

    Example: nas ablate datasets/so101 --minutes 1,2,5,all --test datasets/so101_test --out runs/so101_ablation
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    counts: tuple[str, ...] = ()
    """Numbers of training episodes, such as 10,25,50,all. Default: 10,25,50,100,all, up to the available number."""
    minutes: tuple[str, ...] = ()
    """Minutes of training data, such as 1,2,5,all, instead of --counts; for a few long episodes."""
    seeds: tuple[str, ...] = ("0,1,2",)
    """Seeds; each draws the held-out episodes, the subsets and the initial weights."""
    kinds: tuple[str, ...] = ("delta,forward",)
    """Models to train: delta (φ), forward (ψ), named (the source with effects named by `nas gap`), named_delta."""
    test: Path | None = None
    """Dataset to test on; by default each seed holds out a share of the episodes."""
    held_out: float = 0.2
    """Share of the held-out episodes."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json, for named kinds; by default, `nas gap` runs on each subset."""
    model: str | None = None
    """Source, a model file or robot; only needed if the dataset stores none."""
    engine: str | None = None
    """Physics engine of the source: mujoco or bullet. Default: that of the pairing if it is stored, else mujoco."""
    preset: str = "fast"
    """Hyperparameters of the trainings: fast, few, symmetric, or paper; see `nas train delta --help`."""
    hidden: int | None = None
    """Units of each LSTM layer; the preset's by default."""
    updates: int | None = None
    """Updates of each training with free-running rollouts; the preset's by default."""
    horizon: int | None = None
    """Longest free-running rollout [frames]; the preset's by default."""
    quick: bool = False
    """Small networks and short trainings: a trial run in minutes."""
    retry: bool = False
    """Run failed trials again; --join leaves this to the process that began the run."""
    out: Path = Path("runs/ablation")
    """Folder of the trials' results, ablation.json, ablation.md and ablation.png."""

    def run(self) -> CommandResult:
        """Check the options, run the trials and summarise them."""
        from nas_data.runs.environment_info import find_commit
        from nas_data.studies.ablation import summary, write
        from nas_data.studies.ablation.dry_run import plan_trial
        from nas_data.studies.ablation.sweep import begin_sweep, check, check_same, run_sweep

        workers, plan = self.find_workers(self.out), self._plan()
        check(plan)
        content = plan.material.content()
        trials = plan.trials(content, self.out)
        if self.dry_run:
            check_same(self.out, plan.identity(content))
            dataset = plan.material.read()
            return self.list_jobs([plan_trial(trial, dataset, self.retry) for trial in trials])
        begin_sweep(self.out, plan.identity(content))
        results = run_sweep(trials, workers, self.retry and not self.join, say)
        found = summary.SweepSummary.of([(trial.config, result) for trial, result in zip(trials, results, strict=True)])
        more: dict[str, object] = {
            "sweep": {**plan.identity(content), "effects": content.effects},
            "seeds": plan.seeds,
            "trials": len(trials),
            "code": {trial.config.kind: trial.code for trial in trials},
            "commit": find_commit(),
            "wall_seconds": sum(result.wall_seconds for result in results),
            "cpu_seconds": sum(result.cpu_seconds for result in results),
        }
        files = write.write(self.out, found, more)
        failed = [f"failed: {sentence}" for sentence in found.failed]
        changes = plan.material.list_register_changes() if {"named", "named_delta"} & set(plan.kinds) else []
        notes = [f"Named kinds have the recording's registers, the source has not: {change}." for change in changes]
        text = [
            write.format_table(found),
            "",
            found.sentence(),
            *notes,
            *failed,
            *(f"→ {path}" for path in files.values()),
        ]
        return CommandResult("\n".join(text), {**files, **found.to_json(), **more}, ok=not failed)

    def _plan(self) -> "SweepPlan":
        """Build the plan from the options."""
        from nas_data.dataset import versions
        from nas_data.studies.ablation.sweep import SweepPlan
        from nas_data.studies.ablation.sweep_data import SweepData, split_words

        test = versions.resolve(self.test) if self.test else None
        material = SweepData(versions.resolve(self.dataset), test, self.actuated(self.model), self.engine, self.effects)
        seeds = split_words(self.seeds)
        if not all(word.isdecimal() for word in seeds):
            raise OptionError(f"--seeds are {', '.join(seeds)}; give different whole numbers, 0 or more.")
        return SweepPlan(
            kinds=tuple(dict.fromkeys(split_words(self.kinds))),
            amounts=self._amounts(material.read().n_episodes),
            seeds=tuple(map(int, seeds)),
            options=self._options(),
            held_out=None if test else self.held_out,
            material=material,
        )

    def _amounts(self, episodes: int) -> "tuple[Amount, ...]":
        """Return the amounts of data; `all` becomes the number of episodes, so that no trial runs twice."""
        from dataclasses import replace

        from nas_data.studies.ablation.sweep_data import divide, parse

        if self.counts and self.minutes:
            raise OptionError("Give either --counts or --minutes, not both.")
        if self.minutes:
            return parse(self.minutes, "minutes")
        there = episodes if self.test else len(divide(episodes, self.held_out, 0)[0])
        usual = (*(str(count) for count in DEFAULT_COUNTS if count < there), "all")
        amounts = parse(self.counts or usual, "episodes")
        return tuple(sorted({replace(a, value=float(there)) if a.is_all else a for a in amounts}))

    def _options(self) -> "TrainingOptions":
        """Return the options of the trainings."""
        from nas_data.models.presets import preset

        given = {"hidden": self.hidden, "updates": self.updates, "horizon": self.horizon}
        quick = QUICK if self.quick else {}
        return preset(self.preset, **{**quick, **{name: value for name, value in given.items() if value is not None}})
