"""Statistics of a recording: late, missed and repeated readings, temperatures, pauses and repeated episodes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.recorders.arm_dataset import LATE, REPEATED, TEMPERATURE, VOLTAGE

SUSPICIOUS = 0.01  # share of repeated readings above which the servos update more slowly than the control rate


@dataclass
class RecordingStats:
    """Counts over all sittings of a recording.

    Attributes:
        sittings: Number of starts and resumes.
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


def summary(dataset: Dataset, tally: RecordingStats) -> dict[str, object]:
    """Return the quality figures of a recording: counts, shares, rate [Hz], longest step [s], [°C] and [V]."""
    times = dataset.columns[TIME][:, 0]
    steps = np.concatenate([np.diff(times[rows]) for rows in dataset.episodes()] or [np.array([])])
    late, repeated = (int(dataset.columns[key].sum()) for key in (LATE, REPEATED))
    return {
        "late": late,
        "late_share": late / dataset.n_frames,
        "repeated": repeated,
        "repeated_share": repeated / dataset.n_frames,
        "rate": float(1 / steps.mean()) if len(steps) else dataset.fps,
        "longest_step": float(steps.max()) if len(steps) else 0.0,
        "coldest": float(dataset.columns[TEMPERATURE].min()),
        "warmest": float(dataset.columns[TEMPERATURE].max()),
        "lowest_voltage": float(dataset.columns[VOLTAGE].min()),
        **asdict(tally),
    }


def describe_stats(numbers: Mapping[str, object]) -> list[str]:
    """Return the quality figures as lines of text."""
    lines = [
        f"{numbers['late']} late readings ({_float(numbers, 'late_share'):.3%}), {numbers['repeated']} repeated, "
        f"{numbers['missed']} missed; {numbers['anew']} episodes recorded anew, {numbers['retries']} readings tried "
        "again",
        f"{_float(numbers, 'rate'):.2f} Hz by the clock, longest step {_float(numbers, 'longest_step') * 1e3:.1f} ms; "
        f"servos up to {_float(numbers, 'warmest'):.0f} °C, supply down to {_float(numbers, 'lowest_voltage'):.1f} V, "
        f"{numbers['pauses']} pauses to cool",
    ]
    share = _float(numbers, "repeated_share")
    if share > SUSPICIOUS:
        lines.append(
            f"warning: {share:.0%} of the readings repeat the one before while the arm moves: what answers renews its "
            f"registers at about {_float(numbers, 'rate') * (1 - share):.0f} Hz; check the adapter's latency timer."
        )
    return lines


def _float(numbers: Mapping[str, object], key: str) -> float:
    return float(str(numbers[key]))
