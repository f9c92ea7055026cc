"""Torque off: rows in which commands have no effect because the servo is off."""

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.recording import Recording

SIGNAL = "torque_enable"


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report rows in which the log's `torque_enable` signal is zero for some joint."""
    if SIGNAL not in recording.signals:
        return []
    rows = list_row_numbers(recording.rows, (recording.signals[SIGNAL] == 0).any(axis=1))
    if not rows:
        return []
    what = f"the torque is off in {recording.name_rows(rows)}: the command has no effect there"
    remedy = f"nas.{SIGNAL} marks these rows"
    return [AuditFinding("torque_off", recording.label, what, remedy, rows, minor=True)]
