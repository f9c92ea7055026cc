"""Input and result of audits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.gap.finding.conditions import Loads
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.gap.overlaps import Overlap
from nas_data.gap.report_parts import Check


@dataclass(frozen=True)
class Examined:
    """A recording with predictions of the model."""

    dataset: Dataset  # dataset as recorded, including rows with the torque off
    findings: tuple[AuditFinding, ...]  # findings of the audits of every recording
    recorded: RecordedRows  # rows with the torque on
    nominal: Nominal  # model
    floor: np.ndarray  # noise floor [rad; m], shape (n,)
    predicted: np.ndarray  # the model's open-loop positions [rad; m], shape (E, T, n)
    loads: Loads  # the model's torques in measured states
    overlaps: Sequence[Overlap] = ()  # contacts of the model that the recording contradicts


def summarise_audits(name: str, examined: Examined, checks: Sequence[str], sound: str, advice: str = "") -> Check:
    """Summarise audits of every recording, one sentence for each kind of finding.

    Args:
        name: Name of the check.
        examined: Recording with findings.
        checks: Kinds of findings to include.
        sound: Text without findings.
        advice: Remedy for findings that are not minor.
    """
    kinds: dict[str, list[AuditFinding]] = {}
    for finding in examined.findings:
        if finding.check in checks:
            kinds.setdefault(finding.check, []).append(finding)
    if not kinds:
        return Check(name, sound)
    ok = all(finding.minor for members in kinds.values() for finding in members)
    said = [describe_audit_findings(members, examined.dataset.n_episodes) for members in kinds.values()]
    if advice and not ok:
        said.append(f"{advice[0].upper()}{advice[1:]}.")
    return Check(name, " ".join(said), ok)


def describe_audit_findings(members: Sequence[AuditFinding], episodes: int) -> str:
    """Return the first serious finding of a kind, and the number of episodes with one."""
    grave = [finding for finding in members if not finding.minor] or list(members)
    places = len({finding.file for finding in grave})
    first = grave[0]
    more = f" (so in {places} of {episodes} episodes)" if places > 1 else ""
    return f"In {first.file} {first.what}{more}."


def format_percent(share: float) -> str:
    """Return a share in percent, small ones with more digits."""
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"
