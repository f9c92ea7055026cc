"""Expectations and findings of audits."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.dataset.recording import Recording
from nas_data.dataset.timing import LATE
from nas_data.joint_units import compute_angle_scales

NAMES_MAP = re.compile(r"\[|\bmap\b")  # matches remedies that apply to a map file only
UNWRAP = "import with --unwrap"
REMOVE = "remove the rows, or the episode (nas split --episodes)"  # remedy for wrong readings


@dataclass(frozen=True)
class Remedies:
    """Remedies for recordings that are read without a map file.

    Attributes:
        by_check: Remedies by check; `{rate}` stands for the measured rate [Hz].
        elsewhere: Words before the remedies of other checks that name keys of a map: where these keys belong.
    """

    by_check: Mapping[str, str]
    elsewhere: str = ""

    def apply(self, finding: "AuditFinding", rate: float) -> "AuditFinding":
        """Return a finding with the remedy that applies without a map; `rate` is the measured rate [Hz]."""
        if not finding.remedy or UNWRAP in finding.remedy:  # an option that needs no map
            return finding
        if finding.check in self.by_check:
            return replace(finding, remedy=self.by_check[finding.check].replace("{rate}", f"{rate:.6g}"))
        names_map = self.elsewhere and NAMES_MAP.search(finding.remedy)
        return replace(finding, remedy=f"{self.elsewhere}: {finding.remedy}") if names_map else finding


# Remedies for a dataset that nas imported. A larger max_speed in its map would not end the finding in the dataset.
IMPORTED = Remedies({"jump": f"if readings are wrong, {REMOVE}"}, "import it with a corrected map")


@dataclass(frozen=True)
class Expected:
    """Expectations about a recording.

    Attributes:
        rate: Expected rate [Hz].
        max_speed: Speed that no joint can reach [rad/s; m/s]; None for a default.
        jitter: Largest deviation of a time step, as a share of the period.
        limits: Limits [rad; m] by joint; joints without limits are absent.
        slides: Names of the slide joints, in metres and newtons instead of radians and newton metres.
        kinds: Command quantity by joint: `.pos`, `.vel` or `.effort`; absent joints are commanded positions.
        turns: Whether joints may exceed two turns.
        resampled: Whether rows are resampled to even steps before use.
        derived: Whether velocities are derived from positions instead of read.
        promise: Source of the expected rate, in words, for messages.
        remedies: Remedies in place of those of a map file; None for a map file.
    """

    rate: float
    max_speed: float | None = None
    jitter: float = LATE
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    slides: Collection[str] = frozenset()
    kinds: Mapping[str, str] = field(default_factory=dict)
    turns: bool = False
    resampled: bool = False
    derived: bool = False
    promise: str = "the dataset's rate is"
    remedies: Remedies | None = None

    def find_commanded(self, joints: Sequence[str], kind: str) -> np.ndarray:
        """Return a mask of the joints that are commanded a given quantity, shape (n,)."""
        return np.array([self.kinds.get(joint, POSITION) == kind for joint in joints], bool)


@dataclass(frozen=True)
class AuditFinding:
    """Finding of an audit in one episode.

    Attributes:
        check: Name of the check, for example `irregular_time`.
        file: The log, with its episode if it holds several, or the dataset's episode.
        what: The finding, as a sentence without its full stop.
        remedy: Remedy in the map, as a sentence without its full stop; empty if there is none.
        rows: Affected rows, counted from 0 at the first row of data; empty for all.
        error: Whether the recording is unusable; otherwise the finding is stored with the dataset.
        minor: Whether it has no effect on results.
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
        """The finding and its remedy as one sentence."""
        return f"{self.what}; {self.remedy}." if self.remedy else f"{self.what}."

    def to_json(self) -> dict[str, object]:
        """Return the finding for JSON."""
        return {
            "check": self.check,
            "file": self.file,
            "rows": list(self.rows),
            "count": len(self.rows),
            "message": self.message,
            "severity": "error" if self.error else "warning",
        }


def find_radian_equivalents(recording: Recording, expected: Expected) -> np.ndarray:
    """Return the equivalent of a radian at each joint [rad; slides m], shape (n,), to scale thresholds for angles.

    It is 1 at hinges. At a slide it is a share of its range: of its limits, else its commanded positions, else its
    positions.
    """
    moved, commanded = np.ptp(recording.positions, axis=0), np.ptp(recording.commands, axis=0)
    positional = expected.find_commanded(recording.joints, POSITION)
    reach = np.where(positional & (commanded > 0), commanded, moved)
    limits = [float(np.ptp(expected.limits.get(joint, (0.0, 0.0)))) for joint in recording.joints]
    return compute_angle_scales(recording.joints, expected.slides, np.where(limits, limits, reach))


def list_row_numbers(rows: np.ndarray, chosen: np.ndarray) -> tuple[int, ...]:
    """Return the row numbers of chosen rows (a mask or indices)."""
    return tuple(int(row) for row in rows[chosen])
