"""What an audit compares a recording with, and what it says."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from nas_data.dataset.recording import Recording
from nas_data.dataset.timing import LATE
from nas_data.joint_units import radians_at


@dataclass(frozen=True)
class Expected:
    """What a recording is compared with.

    Attributes:
        rate: Rows a second that are promised [Hz].
        max_speed: Speed that no joint can have [rad/s; m/s]; None for what no usual joint can have.
        jitter: Largest deviation of a time step, as a share of the period.
        limits: Limits [rad; m] by joint; joints without limits are absent.
        slides: Joints that are slides: in metres and newtons, where others are in radians and newton metres.
        effort: Whether commands are not positions [rad; m].
        turns: Whether joints may turn farther than two turns.
        resampled: Whether rows are spaced evenly before they are used.
        derived: Whether velocities are derived from the positions, whatever a register says.
        promise: Who promises the rate, and says so.
    """

    rate: float
    max_speed: float | None = None
    jitter: float = LATE
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    slides: Collection[str] = frozenset()
    effort: bool = False
    turns: bool = False
    resampled: bool = False
    derived: bool = False
    promise: str = "the dataset promises"


@dataclass(frozen=True)
class AuditFinding:
    """What an audit says of one episode.

    Attributes:
        check: What was checked, for example `irregular_time`.
        file: Where it was found: the log, with the episode where it holds several, or the dataset's episode.
        what: What was found, in a sentence without its full stop.
        remedy: What to do about it in a map, likewise; empty where there is nothing to do.
        rows: Rows concerned, counted from 0 at the first row of data; empty where all are.
        error: Whether the recording cannot be used; else it is used and the finding kept with the dataset.
        minor: Whether no result suffers from it.
    """

    check: str
    file: str
    what: str
    remedy: str = ""
    rows: tuple[int, ...] = ()
    error: bool = False
    minor: bool = False

    @property
    def message(self) -> str:
        """One sentence: what was found, and the remedy where there is one."""
        return f"{self.what}; {self.remedy}." if self.remedy else f"{self.what}."

    def to_json(self) -> dict[str, object]:
        """Return the form for machines."""
        return {
            "check": self.check,
            "file": self.file,
            "rows": list(self.rows),
            "count": len(self.rows),
            "message": self.message,
            "severity": "error" if self.error else "warning",
        }


def radian_at(recording: Recording, expected: Expected) -> np.ndarray:
    """Return what stands for a radian at each joint [rad; slides m], shape (n,): thresholds of angles are times this.

    It is 1 at hinges. A slide's range stands for that of a usual hinge: it is that of its limits, else of its commands,
    else of its positions.
    """
    reach = np.ptp(recording.positions, axis=0) if expected.effort else np.ptp(recording.commands, axis=0)
    reach = np.where(reach > 0, reach, np.ptp(recording.positions, axis=0))
    limits = [float(np.ptp(expected.limits.get(joint, (0.0, 0.0)))) for joint in recording.joints]
    return radians_at(recording.joints, expected.slides, np.where(limits, limits, reach))


def row_numbers(rows: np.ndarray, chosen: np.ndarray) -> tuple[int, ...]:
    """Return the recording's row numbers of the chosen rows (a mask or indices)."""
    return tuple(int(row) for row in rows[chosen])
