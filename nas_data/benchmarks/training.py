"""Our training of φ against the paper's recipe: learning curves, and processor time to equal held-out loss."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.api.recording import record
from nas_data.benchmarks.datasets import pair_folder, write_version
from nas_data.benchmarks.result import SECONDS, BenchmarkResult, Ratio, Times
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.envs.ergo_reacher import TASK
from nas_data.models.optimiser import Optimiser
from nas_data.models.presets import TrainingOptions, preset
from nas_data.models.threads import one_thread
from nas_data.models.training import ModelTraining
from nas_data.runs.progress import say

ENVIRONMENT, DYNAMICS = "ErgoReacher", "backlash"
PAPER = preset("paper")
TUNED = replace(PAPER, rate=1e-3)  # what tuning by factors of ten finds
FAST = preset("fast", updates=0)
RECIPE = replace(FAST, relative=PAPER.relative, shortcut=PAPER.shortcut)
GOAL = 8.0
GOAL_TUNED = 1.0


@dataclass(frozen=True)
class Point:
    """State of a training at the end of an epoch."""

    cpu: float  # processor time since the start of the training [s], without validations
    wall: float  # elapsed time [s], without validations
    loss: float  # best one-step error on the held-out episodes so far, mean square in units of the target's spread


Curve = tuple[Point, ...]


@dataclass(frozen=True)
class Race:
    """Learning curves of one seed, all on the same split of the same episodes."""

    paper: Curve  # the paper's recipe, stopped when its time was used up
    tuned: Curve  # the same with a tenth of its learning rate
    fast: Curve  # our preset, stopped when its loss was as low as both
    recipe: Curve  # our preset's recipe on the paper's network

    @classmethod
    def run(cls, dataset: Dataset, seed: int, budget: float) -> "Race":
        """Run the four trainings; the paper's recipe and its tuned form get `budget` seconds of processor time each."""
        paper, tuned = (
            learn(dataset, replace(options, seed=seed), lambda point: point.cpu >= budget) for options in (PAPER, TUNED)
        )
        goals = {FAST: min(paper[-1].loss, tuned[-1].loss), RECIPE: paper[-1].loss}
        fast, recipe = (
            learn(dataset, replace(options, seed=seed), lambda point, goal=goal: point.loss <= goal)  # type: ignore[misc]
            for options, goal in goals.items()
        )
        return cls(paper, tuned, fast, recipe)

    def seconds(self) -> Mapping[str, tuple[float, float]]:
        """Return the processor and elapsed time [s] of each side."""
        return {
            "paper": (self.paper[-1].cpu, self.paper[-1].wall),
            "tuned": (self.tuned[-1].cpu, self.tuned[-1].wall),
            "nas, to paper's loss": find_time_to_loss(self.fast, self.paper[-1].loss),
            "nas, to tuned's loss": find_time_to_loss(self.fast, self.tuned[-1].loss),
            "recipe, to paper's loss": find_time_to_loss(self.recipe, self.paper[-1].loss),
        }


def benchmark(scratch: Path, episodes: int, budget: int, seeds: int) -> BenchmarkResult:
    """Measure how much sooner our preset reaches the held-out loss of the paper's recipe.

    The paper's recipe (batch 1, Adam, learning rate 0.01; appendix A.1) trains φ for `budget` seconds of processor
    time. Its loss is the lowest on the held-out episodes until then. Our preset `fast` trains until the end of the
    first epoch with a loss as low. `training_vs_paper` is the ratio of the two times, median over seeds; 0 if that loss
    is never reached. Both use teacher forcing, the same episodes, the same split and the same normalisation of the
    loss. The time of validations does not count.

    Two more ratios: `training_vs_tuned`, against the paper's recipe at a tenth of its learning rate, and
    `recipe_vs_paper`, our recipe on the paper's network.

    Args:
        scratch: Empty folder.
        episodes: Episodes of ErgoReacher with backlash, one second each.
        budget: Processor time [s].
        seeds: Number of seeds, from 0.
    """
    say(f"recording {episodes} episodes …")
    recording = record(env=ENVIRONMENT, dynamics=DYNAMICS, episodes=episodes, quantum=0.0)
    recorded = write_version(recording, scratch / "recorded")
    dataset = read(pair_folder(recorded, TASK.robot, scratch / "paired"))
    races = []
    for seed in range(seeds):
        races.append(Race.run(dataset, seed, budget))
        say(f"seed {seed}: {describe_losses(races[-1])}")
    return BenchmarkResult(
        title=f"Training φ on {episodes} episodes of {ENVIRONMENT} with backlash; one column a seed",
        times=as_times(races),
        ratios=(
            Ratio("training_vs_paper", "nas, to paper's loss", "paper", GOAL, "cpu"),
            Ratio("training_vs_tuned", "nas, to tuned's loss", "tuned", GOAL_TUNED, "cpu"),
            Ratio("recipe_vs_paper", "recipe, to paper's loss", "paper", None, "cpu"),
        ),
        notes=tuple(f"Seed {seed}: {describe_losses(race)}" for seed, race in enumerate(races)),
        unit=SECONDS,
    )


def as_times(races: Sequence[Race]) -> dict[str, Times]:
    """Return the times of each side, one round per seed."""
    rows = [race.seconds() for race in races]
    return {
        side: Times(wall=tuple(row[side][1] for row in rows), cpu=tuple(row[side][0] for row in rows))
        for side in rows[0]
    }


def describe_losses(race: Race) -> str:
    """Describe the losses reached, in one sentence."""
    paper, tuned, fast = race.paper[-1], race.tuned[-1], race.fast[-1]
    return (
        f"held-out loss {paper.loss:.3f} by the paper's recipe in {len(race.paper)} epochs, {tuned.loss:.3f} at a "
        f"tenth of its learning rate; {fast.loss:.3f} by ours in {fast.cpu:.1f} s."
    )


@one_thread()
def learn(dataset: Dataset, options: TrainingOptions, enough: Callable[[Point], bool]) -> Curve:
    """Train φ by teacher forcing, epoch by epoch.

    Args:
        dataset: Paired episodes.
        options: Options of the training.
        enough: Called after each epoch; the training stops if it returns True, or at the end of its schedule.

    Returns:
        One point per epoch, at least one. The first includes the time before the first epoch (normalisation and the
        closed-form fit of the shortcut).
    """
    clock = Stopwatch()
    training = ModelTraining("delta", dataset, options, device="cpu")
    descent, curve = Optimiser(training), list[Point]()
    for epoch in range(options.epochs):
        first = epoch * training.phase.per_validation
        for number in range(first, first + training.phase.per_validation):
            descent.update(number)
        clock.stop()
        best = min(training.validation_error(), curve[-1].loss if curve else math.inf)
        curve.append(Point(clock.cpu, clock.wall, best))
        if enough(curve[-1]):
            break
        clock.go()
    return tuple(curve)


def find_time_to_loss(curve: Curve, loss: float) -> tuple[float, float]:
    """Return the processor and elapsed time [s] at which a held-out loss was reached; infinite if never."""
    return next(((point.cpu, point.wall) for point in curve if point.loss <= loss), (math.inf, math.inf))


class Stopwatch:
    """Processor and elapsed time [s]."""

    def __init__(self) -> None:
        """Start at zero."""
        self.cpu = self.wall = 0.0
        self.go()

    def go(self) -> None:
        """Start or continue."""
        self._since = time.process_time(), time.perf_counter()

    def stop(self) -> None:
        """Stop; `cpu` and `wall` hold the time so far."""
        cpu, wall = self._since
        self.cpu += time.process_time() - cpu
        self.wall += time.perf_counter() - wall
