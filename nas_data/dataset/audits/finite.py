"""NaN and infinity: rows with such values cannot be imported."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.recording import Recording


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse values that are not finite, by quantity and row."""
    columns = {
        "time": recording.time,
        "position": recording.positions,
        "velocity": recording.velocities,
        "command": recording.commands,
        **recording.signals,
    }
    found = []
    for name, values in columns.items():
        if values is None:
            continue
        bad = ~np.isfinite(values.reshape(len(recording), -1)).all(axis=1)
        if bad.any():
            rows = list_row_numbers(recording.rows, bad)
            what = f"the {name} is empty, NaN or infinite in {recording.name_rows(rows)}"
            remedy = "remove these rows, or split the log there"
            found.append(AuditFinding("not_finite", recording.label, what, remedy, rows, error=True))
    return found
