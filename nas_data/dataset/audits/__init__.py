"""Audits of recordings: each file of the folder checks one thing, and one set of them serves logs and datasets.

`nas import` runs them over the rows of a log as they were recorded, `nas gap find`, `nas verify` and the commands that
read LeRobot's datasets over the rows of a dataset.
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
LEAST_ROWS = 2  # of an episode that is looked at further: nothing moves within one row


class Audit(Protocol):
    """What a file of this folder defines."""

    def check(self, recording: Recording, expected: Expected) -> list[AuditFinding]:
        """Look at one recording as it was recorded: in SI, nothing resampled."""


def find_audit(name: str) -> Audit:
    """Return an audit by its name."""
    return cast(Audit, registry.import_plugin("dataset.audits", name, "audit"))


def audit_dataset(
    dataset: Dataset, remedies: Remedies | None = None, turns: bool | None = None
) -> tuple[AuditFinding, ...]:
    """Run every audit over each episode of a dataset.

    Args:
        dataset: Transitions, or states and commands of named joints.
        remedies: What puts findings right, if that is no map file.
        turns: Whether joints may exceed two turns; if None, where units are stored.
    """
    if turns is None:  # where units are stored, someone knows them: as_transitions refuses others than rad
        turns = bool(dataset.features[STATE].units)
    kinds = dict(zip(dataset.joints, dataset.kinds, strict=True))
    expected = Expected(rate=dataset.fps, slides=dataset.slides, kinds=kinds, turns=turns, remedies=remedies)
    return tuple(finding for recording in extract_recordings(dataset) for finding in audit(recording, expected))


def audit(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Run every audit over one recording.

    Returns:
        Findings. Where values or times are unusable, only that is reported, because everything else would follow.
    """
    found = run(FIRST, recording, expected)
    if any(finding.error for finding in found) or len(recording) < LEAST_ROWS:
        return found
    return found + run(list_remaining_audits(), recording, expected)


def list_remaining_audits() -> list[str]:
    """Return the audits that need finite values in several rows whose time goes on."""
    return [name for name in registry.list_names("dataset.audits") if name not in FIRST]


def run(names: Sequence[str], recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Run some audits over one recording."""
    found = [finding for name in names for finding in find_audit(name).check(recording, expected)]
    if expected.remedies is None:
        return found
    return [expected.remedies.apply(finding, measure_rate(recording.time)) for finding in found]
