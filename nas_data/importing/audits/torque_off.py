"""Torque off: rows in which the commands cannot act because the servo is released."""

from nas_data.importing.finding import Finding, row_numbers
from nas_data.importing.map import Map
from nas_data.importing.recording import Recording
from nas_data.importing.rows import rows_text

SIGNAL = "torque_enable"


def check(recording: Recording, mapping: Map) -> list[Finding]:
    """Report rows in which the log's `torque_enable` signal is zero for some joint."""
    if SIGNAL not in recording.signals:
        return []
    rows = row_numbers(recording.rows, (recording.signals[SIGNAL] == 0).any(axis=1))
    if not rows:
        return []
    message = (
        f"the torque is off in {rows_text(rows)}: the command does not act there; nas.{SIGNAL} tells these rows apart."
    )
    return [Finding("torque_off", recording.place, message, rows)]
