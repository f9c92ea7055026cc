"""Result of a benchmark: times of each side, their ratios, and the hardware."""

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Literal

from nas_data.dataset.provenance import read_package_versions
from nas_data.runs.parallel import count_cores
from nas_data.runs.progress import say
from nas_data.text_table import align_columns
from nas_data.typed_json import as_object

CPUINFO = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Hardware:
    """The machine of a benchmark."""

    processor: str  # its model
    cores: int  # number of usable cores
    load: float  # load average
    system: str  # operating system and architecture
    versions: Mapping[str, str]  # versions of Python and of the packages


def read_hardware() -> Hardware:
    """Return the hardware of this machine, and its load."""
    return Hardware(
        processor=read_processor_model(),
        cores=count_cores(),
        load=round(os.getloadavg()[0], 1),
        system=f"{platform.system()} {platform.machine()}",
        versions=read_package_versions(),
    )


def read_processor_model() -> str:
    """Return the processor model; the architecture if the model is unknown."""
    if CPUINFO.is_file():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


Work = Callable[[], int]


@dataclass(frozen=True)
class Times:
    """Times of one side."""

    wall: tuple[float, ...]  # elapsed time per frame of each round [s]
    cpu: tuple[float, ...]  # processor time of all threads per frame of each round [s]


def take_turns(sides: Mapping[str, Work], rounds: int) -> dict[str, Times]:
    """Time several implementations of the same work.

    Each side runs once untimed, for imports, caches and compilers. Sides then alternate, in reversed order after each
    round, so that other load affects all of them.

    Args:
        sides: Name of a side → its work, which returns the number of frames.
        rounds: Number of timed rounds.
    """
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in sides}
    for number in range(rounds + 1):
        for name in list(sides) if number % 2 else reversed(list(sides)):
            start, spent = time.perf_counter(), time.process_time()
            frames = sides[name]()
            took = (time.perf_counter() - start) / frames, (time.process_time() - spent) / frames
            if number:
                found[name].append(took)
                say(f"round {number} of {rounds}: {name} {took[0] * 1e6:.4g} µs a frame")
    return {name: Times(tuple(wall for wall, _ in took), tuple(cpu for _, cpu in took)) for name, took in found.items()}


@dataclass(frozen=True)
class Ratio:
    """Speed of one side relative to another."""

    name: str  # its name in `--json`, for example `pairing_vs_rollout`
    ours: str  # name of our side
    other: str  # name of the other side
    wanted: float | None = None  # required ratio; None if there is none
    # `wall`, or `cpu` if other load on the machine would dominate the elapsed time
    clock: Literal["wall", "cpu"] = "wall"

    def values(self, times: Mapping[str, Times]) -> list[float]:
        """Return the other time divided by ours for each round; above 1 our side is faster."""
        ours, other = (getattr(times[side], self.clock) for side in (self.ours, self.other))
        return [theirs / mine for mine, theirs in zip(ours, other, strict=True)]

    def of(self, times: Mapping[str, Times]) -> float:
        """Return the median over the rounds."""
        return median(self.values(times))

    def describe(self, times: Mapping[str, Times]) -> str:
        """Return the ratio with its spread as a sentence."""
        values = self.values(times)
        bar = "" if self.wanted is None else f", required: at least {self.wanted:.2g}"
        return (
            f"{self.name} {self.of(times):.3g}, between {min(values):.3g} and {max(values):.3g} "
            f"in {len(values)} rounds{' of processor time' if self.clock == 'cpu' else ''}{bar}"
        )


@dataclass(frozen=True)
class Unit:
    """Unit of times."""

    heading: str  # heading of tables
    key: str  # key in JSON
    factor: float  # factor from seconds


MICROSECONDS_A_FRAME = Unit("µs a frame", "microseconds_per_frame", 1e6)
SECONDS = Unit("seconds", "seconds", 1.0)


@dataclass(frozen=True)
class BenchmarkResult:
    """Result of a benchmark."""

    title: str  # description of the work
    times: Mapping[str, Times]  # name of each side → its times
    ratios: tuple[Ratio, ...]  # ratios; the first is the main one
    notes: tuple[str, ...] = ()  # notes on the limits of the numbers
    unit: Unit = MICROSECONDS_A_FRAME  # unit of the times

    def to_text(self) -> str:
        """Return title, times per frame of each round, ratios and hardware as text."""
        machine = read_hardware()
        on = f"{machine.processor}, {machine.cores} cores, load {machine.load}, {machine.system}"
        with_versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
        ratios = [ratio.describe(self.times) for ratio in self.ratios]
        return "\n".join([self.title, "", *self._format_table(), "", *ratios, *self.notes, f"{on}; {with_versions}"])

    def _format_table(self) -> list[str]:
        """Return one line per side with its times; the last column is the shortest processor time."""
        rounds = range(1, len(next(iter(self.times.values())).wall) + 1)
        rows = [[f"{self.unit.heading} in round", *map(str, rounds), "cpu"]]
        rows += [
            [name, *(f"{seconds * self.unit.factor:.4g}" for seconds in (*times.wall, min(times.cpu)))]
            for name, times in self.times.items()
        ]
        return align_columns(rows, least=6)

    def to_json(self) -> dict[str, object]:
        """Return the result for JSON; times are in the unit of their key."""
        return {
            "ratios": {ratio.name: ratio.of(self.times) for ratio in self.ratios},
            "rounds": {ratio.name: ratio.values(self.times) for ratio in self.ratios},
            "wanted": {ratio.name: ratio.wanted for ratio in self.ratios if ratio.wanted is not None},
            self.unit.key: {
                name: {
                    "wall": [self.unit.factor * wall for wall in times.wall],
                    "cpu": [self.unit.factor * cpu for cpu in times.cpu],
                }
                for name, times in self.times.items()
            },
            "title": self.title,
            "notes": self.notes,
            "hardware": as_object(read_hardware()),
        }
