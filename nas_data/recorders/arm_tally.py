"""Statistics of a recording: late, missed and repeated readings, temperatures, pauses and repeated episodes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.supply_voltage import VOLTAGE
from nas_data.recorders.arm_dataset import LATE, REPEATED, TEMPERATURE

SUSPICIOUS = 0.01  # share of repeated readings above which the servos update more slowly than the control rate


@dataclass
class RecordingStats:
    """Counts over all sessions of a recording.

    Attributes:
        sittings: Number of sessions: starts and resumes.
        missed: Readings that were late by more than a control period.
        anew: Episodes that were repeated after a missed reading or a bus error.
        pauses: Number of pauses for cooling.
        retries: Readings that needed more than one attempt.
    """

    sittings: int = 0
    missed: int = 0
    anew: int = 0
    pauses: int = 0
    retries: int = 0

    @classmethod
    def of(cls, target: Mapping[str, object] | None) -> Self:
        """Read the counts from a recording's provenance."""
        stored = (target or {}).get("tally")
        known = dict(stored) if isinstance(stored, Mapping) else {}
        return cls(**{key: int(known.get(key, 0)) for key in asdict(cls())})


@dataclass(frozen=True)
class RecordingQuality:
    """Quality of a recording.

    Attributes:
        late: Number of late readings.
        late_share: Share of late readings.
        repeated: Number of readings that repeat the previous one while the arm moves.
        repeated_share: Share of repeated readings.
        rate: Mean rate by the recorder's clock [Hz].
        longest_step: Longest time between two readings [s].
        coldest: Lowest temperature of a servo [°C].
        warmest: Highest temperature of a servo [°C].
        lowest_voltage: Lowest supply voltage [V].
        stats: Counts over all sittings.
    """

    late: int
    late_share: float
    repeated: int
    repeated_share: float
    rate: float
    longest_step: float
    coldest: float
    warmest: float
    lowest_voltage: float
    stats: RecordingStats

    @classmethod
    def of(cls, dataset: Dataset, stats: RecordingStats) -> Self:
        """Compute the quality of the recorded episodes."""
        times = dataset.columns[TIME][:, 0]
        steps = np.concatenate([np.diff(times[rows]) for rows in dataset.episodes()] or [np.array([])])
        late, repeated = (int(dataset.columns[key].sum()) for key in (LATE, REPEATED))
        return cls(
            late=late,
            late_share=late / dataset.n_frames,
            repeated=repeated,
            repeated_share=repeated / dataset.n_frames,
            rate=float(1 / steps.mean()) if len(steps) else dataset.fps,
            longest_step=float(steps.max()) if len(steps) else 0.0,
            coldest=float(dataset.columns[TEMPERATURE].min()),
            warmest=float(dataset.columns[TEMPERATURE].max()),
            lowest_voltage=float(dataset.columns[VOLTAGE].min()),
            stats=stats,
        )

    def to_json(self) -> dict[str, object]:
        """Return all figures and counts for JSON."""
        return {**{key: value for key, value in vars(self).items() if key != "stats"}, **asdict(self.stats)}

    def lines(self) -> list[str]:
        """Return the figures as lines of text."""
        stats = self.stats
        lines = [
            f"{self.late} late readings ({self.late_share:.3%}), {self.repeated} repeated, {stats.missed} missed; "
            f"{count_of(stats.anew, 'episode')} recorded again, {count_of(stats.retries, 'reading')} read more than "
            "once",
            f"{self.rate:.2f} Hz by the clock, longest step {self.longest_step * 1e3:.1f} ms; servos up to "
            f"{self.warmest:.0f} °C, supply down to {self.lowest_voltage:.1f} V, {stats.pauses} pauses to cool",
        ]
        if self.repeated_share > SUSPICIOUS:
            lines.append(
                f"warning: {self.repeated_share:.0%} of the readings repeat the previous one while the arm moves: the "
                f"servos or the adapter update at about {self.rate * (1 - self.repeated_share):.0f} Hz; check the "
                "adapter's latency timer."
            )
        return lines
