"""Result of a benchmark: a table of times, the ratios, and the hardware."""

from collections.abc import Mapping
from dataclasses import dataclass

from nas_data.benchmarks.hardware import read_hardware
from nas_data.benchmarks.rounds import Ratio, Times
from nas_data.text_table import align_columns
from nas_data.typed_json import as_object


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
