"""Cost of parallel workers: processor time of a short training alone and with others."""

import json
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.atomic_file import write_atomic
from nas_data.dataset.layout import read_json
from nas_data.models.threads import one_thread
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.trial import UNFINISHED, Trial, prepare
from nas_data.typed_json import from_json

FILE = "inflation.json"
PROBE_UPDATES = 10  # length of a timing probe: seconds of work
PROBE_EPOCHS = 1  # length of a timing probe with teacher forcing


@dataclass(frozen=True)
class Inflation:
    """Times of the same short training with one worker and with several.

    Attributes:
        workers: Number of parallel workers.
        cpu_alone: Processor time with one worker [s].
        cpu_beside: Processor time with several workers, median [s].
        wall_alone: Wall time with one worker [s].
        wall_beside: Wall time with several workers [s].
    """

    workers: int
    cpu_alone: float
    cpu_beside: float
    wall_alone: float
    wall_beside: float

    @property
    def factor(self) -> float:
        """Ratio of processor times with several workers and with one."""
        return self.cpu_beside / self.cpu_alone

    @property
    def work(self) -> float:
        """Ratio of throughputs with several workers and with one."""
        return self.workers * self.wall_alone / self.wall_beside

    def sentence(self) -> str:
        """Return the result as a sentence."""
        return (
            f"With {self.workers} workers a short training takes {self.factor:.2f} times the processor time that it "
            f"takes with one, and {self.work:.2f} times as much is done in the same time."
        )

    def to_json(self) -> dict[str, object]:
        """Return the times and both ratios."""
        return {**asdict(self), "cpu_inflation": self.factor, "work_ratio": self.work}


@dataclass(frozen=True)
class Probe:
    """A timing probe: a short training.

    Attributes:
        trial: The trial that it shortens.
    """

    trial: Trial


Cost = tuple[float, float]
"""Processor and wall time [s]."""


def read(folder: Path) -> Inflation | None:
    """Return the measurement from the start of a sweep; None if there is none."""
    path = folder / FILE
    if not path.is_file():
        return None
    return from_json(Inflation, read_json(path))


def keep(folder: Path, found: Inflation | None) -> None:
    """Write the measurement into a sweep's folder, if there is one."""
    if found is not None:
        write_atomic(folder / FILE, (json.dumps(found.to_json(), indent=1) + "\n").encode())


def make_probes(trials: Sequence[Trial], workers: int, folder: Path) -> list[Probe]:
    """Return timing probes: one per worker to run in parallel, and then one to run alone.

    Args:
        trials: Trials to run; the smallest one that trains a network is shortened.
        workers: Number of parallel workers.
        folder: The sweep's folder.

    Returns:
        The probes; empty if no network is trained, there is one worker, or the sweep has a measurement.
    """
    training = [trial for trial in trials if find_kind(trial.config.kind).trains and not must_name(trial)]
    if workers < 2 or not training or read(folder) is not None:
        return []
    return [Probe(make_short_trial(min(training, key=lambda trial: trial.config.amount)))] * (workers + 1)


def order_jobs(probes: int, jobs: int) -> dict[int, list[int]]:
    """Return the dependencies of jobs whose first ones are probes.

    The last probe runs alone after the others, and all other jobs wait for it.
    """
    if not probes:
        return {}
    last = probes - 1
    return {last: list(range(last)), **{number: [last] for number in range(probes, jobs)}}


def compute_inflation(costs: Sequence[Cost | None]) -> Inflation | None:
    """Return the result of the probes, the last of which ran alone; None if one failed."""
    known = [cost for cost in costs if cost is not None]
    if not known or len(known) < len(costs):
        return None
    others, alone = np.median(known[:-1], axis=0), known[-1]
    return Inflation(len(known) - 1, alone[0], float(others[0]), alone[1], float(others[1]))


def must_name(trial: Trial) -> bool:
    """Return whether a trial searches for effects first, which takes minutes."""
    return find_kind(trial.config.kind).names and trial.material.effects is None


def make_short_trial(trial: Trial) -> Trial:
    """Return a shortened trial that takes seconds."""
    options = trial.config.options
    short = replace(options, updates=min(options.updates, PROBE_UPDATES), epochs=min(options.epochs, PROBE_EPOCHS))
    return replace(trial, config=replace(trial.config, options=short))


def measure_cost(probe: Probe) -> Cost | None:
    """Train twice, and return the cost of the second time, when all code is loaded; None on failure."""
    try:
        learn(probe.trial)
        return learn(probe.trial)
    except Exception:  # the trial itself reports the error later
        return None


def learn(trial: Trial) -> Cost:
    """Train as in a trial, and return the cost."""
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
