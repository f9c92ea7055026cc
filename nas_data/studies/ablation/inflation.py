"""What a second worker costs: the processor time of a short training alone, and beside another of its kind."""

import json
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.dataset.layout import read_json
from nas_data.models.threads import one_thread
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.trial import UNFINISHED, Trial, prepare
from nas_data.whole_file import write_whole

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


@dataclass(frozen=True)
class Probe:
    """A short training that only measures.

    Attributes:
        trial: What is learned from.
    """

    trial: Trial


Cost = tuple[float, float]
"""Processor and wall time [s]."""


def read(folder: Path) -> Inflation | None:
    """Return what was measured when a sweep began; None where nothing was."""
    path = folder / FILE
    if not path.is_file():
        return None
    return Inflation(**{key: value for key, value in read_json(path).items() if key in NUMBERS})  # type: ignore[arg-type]


def keep(folder: Path, found: Inflation | None) -> None:
    """Write what was measured into a sweep's folder, where it could be."""
    if found is not None:
        write_whole(folder / FILE, (json.dumps(found.to_json(), indent=1) + "\n").encode())


def probes(trials: Sequence[Trial], workers: int, folder: Path) -> list[Probe]:
    """Return what measures: as many probes as there are workers, side by side, and then one alone.

    Args:
        trials: Those to be done, of which the smallest that trains a network is shortened.
        workers: How many run at a time.
        folder: The sweep's.

    Returns:
        Nothing where no network is trained, one worker has nothing beside it, or it was measured before.
    """
    training = [trial for trial in trials if find_kind(trial.config.kind).trains and not must_name(trial)]
    if workers < 2 or not training or read(folder) is not None:
        return []
    return [Probe(make_short_trial(min(training, key=lambda trial: trial.config.amount)))] * (workers + 1)


def order(probes: int, jobs: int) -> dict[int, list[int]]:
    """Return what each of some jobs waits for, the first of which are probes.

    The last probe, which is alone, waits for the others; all that is no probe waits for it.
    """
    if not probes:
        return {}
    last = probes - 1
    return {last: list(range(last)), **{number: [last] for number in range(probes, jobs)}}


def inflation_of(costs: Sequence[Cost | None]) -> Inflation | None:
    """Return what the probes found, the last of which was alone; None where one of them failed."""
    known = [cost for cost in costs if cost is not None]
    if not known or len(known) < len(costs):
        return None
    others, alone = np.median(known[:-1], axis=0), known[-1]
    return Inflation(len(known) - 1, alone[0], float(others[0]), alone[1], float(others[1]))


def must_name(trial: Trial) -> bool:
    """Whether a trial would first search for effects, for minutes."""
    return find_kind(trial.config.kind).names and trial.material.effects is None


def make_short_trial(trial: Trial) -> Trial:
    """Return a trial that takes seconds."""
    options = trial.config.options
    short = replace(options, updates=min(options.updates, PROBE_UPDATES), epochs=min(options.epochs, PROBE_EPOCHS))
    return replace(trial, config=replace(trial.config, options=short))


def cost(probe: Probe) -> Cost | None:
    """Learn as a trial does, twice, and return what the second took, when all is loaded; None where it cannot."""
    try:
        learn(probe.trial)
        return learn(probe.trial)
    except Exception:  # its trial says why, when it is its turn
        return None


def learn(trial: Trial) -> Cost:
    """Learn as a trial does, and return what that took."""
    trial.folder.joinpath(UNFINISHED).mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix="probe-", dir=trial.folder / UNFINISHED))
    try:
        lesson, _, _ = prepare(trial, folder)
        wall, cpu = time.perf_counter(), time.process_time()
        with one_thread(), threadpool_limits(1):
            find_kind(trial.config.kind).learn(lesson)
        return time.process_time() - cpu, time.perf_counter() - wall
    finally:
        shutil.rmtree(folder, ignore_errors=True)
