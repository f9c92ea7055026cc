"""What a second worker costs: the processor time of a short training alone, and beside another of its kind."""

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.ablation.executors.base import Executor
from nas_data.ablation.kinds.base import find_kind
from nas_data.ablation.trial import UNFINISHED, Trial, prepare
from nas_data.dataset.layout import read_json
from nas_data.models.threads import one_thread
from nas_data.reports.file import write_whole

FILE = "inflation.json"
PROBE_UPDATES = 10  # of a trial that only measures: seconds of work
PROBE_EPOCHS = 1  # the same for one that is trained by teacher forcing


@dataclass(frozen=True)
class Inflation:
    """The same short training with one worker and with several, measured in one run.

    Attributes:
        workers: How many were beside each other.
        cpu_alone: Processor time with one worker [s].
        cpu_beside: The same with several, median of them.
        wall_alone: Wall time with one worker [s].
        wall_beside: The same with several.
    """

    workers: int
    cpu_alone: float
    cpu_beside: float
    wall_alone: float
    wall_beside: float

    @property
    def factor(self) -> float:
        """How much more processor time a training takes beside others."""
        return self.cpu_beside / self.cpu_alone

    @property
    def work(self) -> float:
        """How much more work is done per second of wall time than by one worker."""
        return self.workers * self.wall_alone / self.wall_beside

    def sentence(self) -> str:
        """Say it."""
        return (
            f"With {self.workers} workers a short training takes {self.factor:.2f} times the processor time that it "
            f"takes with one, and {self.work:.2f} times as much is done in the same time."
        )

    def to_json(self) -> dict[str, object]:
        """Return the times and both ratios."""
        return {**asdict(self), "cpu_inflation": self.factor, "work_ratio": self.work}


NUMBERS = tuple(field.name for field in fields(Inflation))


def of_sweep(
    folder: Path, trials: Sequence[Trial], executor: Executor, workers: int, say: Callable[[str], None]
) -> Inflation | None:
    """Return what was measured when the sweep began, or measure it where there is work left.

    Args:
        folder: The sweep's.
        trials: Those still to be done.
        executor: Where they run.
        workers: How many run at a time.
        say: Told of the measurement.
    """
    path = folder / FILE
    if path.is_file():
        return Inflation(**{key: value for key, value in read_json(path).items() if key in NUMBERS})  # type: ignore[arg-type]
    found = measure(trials, executor, workers, say)
    if found:
        write_whole(path, (json.dumps(found.to_json(), indent=1) + "\n").encode())
    return found


def measure(trials: Sequence[Trial], executor: Executor, workers: int, say: Callable[[str], None]) -> Inflation | None:
    """Train for a moment alone, side by side, and alone again; nothing is recorded.

    Args:
        trials: Those to be done, of which the smallest that trains a network is shortened.
        executor: Where they run.
        workers: How many run at a time.
        say: Told of it.

    Returns:
        None where no network is trained, or one worker has nothing beside it.
    """
    training = [trial for trial in trials if find_kind(trial.config.kind).trains and not must_name(trial)]
    if workers < 2 or not training:
        return None
    say(f"measuring a short training with one worker and with {workers}")
    probe = shortened(min(training, key=lambda trial: trial.config.amount))
    before = dict(executor(cost, [probe], 1))[0]
    beside = [pair for _, pair in executor(cost, [probe] * workers, workers)]
    after = dict(executor(cost, [probe], 1))[0]
    alone, others = np.median([before, after], axis=0), np.median(beside, axis=0)
    return Inflation(workers, float(alone[0]), float(others[0]), float(alone[1]), float(others[1]))


def must_name(trial: Trial) -> bool:
    """Whether a trial would first search for effects, for minutes."""
    return find_kind(trial.config.kind).names and trial.material.effects is None


def shortened(trial: Trial) -> Trial:
    """Return a trial that takes seconds."""
    options = trial.config.options
    short = replace(options, updates=min(options.updates, PROBE_UPDATES), epochs=min(options.epochs, PROBE_EPOCHS))
    return replace(trial, config=replace(trial.config, options=short))


def cost(trial: Trial) -> tuple[float, float]:
    """Learn as a trial does, twice, and return processor and wall time [s] of the second, when everything is loaded."""
    wall = cpu = 0.0
    for _ in range(2):
        trial.folder.joinpath(UNFINISHED).mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="probe-", dir=trial.folder / UNFINISHED))
        lesson, _, _ = prepare(trial, folder)
        wall, cpu = time.perf_counter(), time.process_time()
        with one_thread(), threadpool_limits(1):
            find_kind(trial.config.kind).learn(lesson)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        shutil.rmtree(folder)
    return cpu, wall
