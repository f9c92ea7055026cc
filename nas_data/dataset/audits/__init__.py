"""Audits of recordings: each file of the folder is one check, for logs and datasets alike.

`nas import` runs them over the rows of a log as recorded. `nas gap find`, `nas verify` and the commands that read
LeRobot's datasets run them over the rows of a dataset.
"""

from collections.abc import Sequence
from typing import Protocol, cast

from nas_data import registry
from nas_data.dataset.audits.base import AuditFinding, Expected, Remedies
from nas_data.dataset.audits.timing import measure_rate
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import STATE
from nas_data.dataset.recording import Recording, extract_recordings

FIRST = ("finite", "timing")
LEAST_ROWS = 2  # of an episode that is audited further; a single row has no motion


class Audit(Protocol):
    """Interface of a file of this folder."""

    def check(self, recording: Recording, expected: Expected) -> list[AuditFinding]:
        """Check one recording in SI units, as recorded, without resampling."""


def find_audit(name: str) -> Audit:
    """Return an audit by its name."""
    return cast(Audit, registry.import_plugin("dataset.audits", name, "audit"))


def audit_dataset(
    dataset: Dataset, remedies: Remedies | None = None, turns: bool | None = None
) -> tuple[AuditFinding, ...]:
    """Run every audit over each episode of a dataset.

    Args:
        dataset: Transitions, or states and commands of named joints.
        remedies: Remedies for findings if there is no map file.
        turns: Whether joints may exceed two turns; if None, they may if units are stored.
    """
    if turns is None:  # stored units are trusted; as_transitions refuses all but rad
        turns = bool(dataset.features[STATE].units)
    kinds = dict(zip(dataset.joints, dataset.kinds, strict=True))
    expected = Expected(rate=dataset.fps, slides=dataset.slides, kinds=kinds, turns=turns, remedies=remedies)
    return tuple(finding for recording in extract_recordings(dataset) for finding in audit(recording, expected))


def audit(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Run every audit over one recording.

    Returns:
        Findings. If values or times are unusable, only those, because all other findings would follow from them.
    """
    found = run(FIRST, recording, expected)
    if any(finding.error for finding in found) or len(recording) < LEAST_ROWS:
        return found
    return found + run(list_remaining_audits(), recording, expected)


def list_remaining_audits() -> list[str]:
    """Return the audits that need finite values in several rows with increasing time."""
    return [name for name in registry.list_names("dataset.audits") if name not in FIRST]


def run(names: Sequence[str], recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Run some audits over one recording."""
    found = [finding for name in names for finding in find_audit(name).check(recording, expected)]
    if expected.remedies is None:
        return found
    return [expected.remedies.apply(finding, measure_rate(recording.time)) for finding in found]
