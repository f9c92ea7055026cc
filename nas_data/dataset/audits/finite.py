"""NaN and infinity: rows with such values cannot be imported."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.recording import Recording


def name_absent(name: str) -> str:
    """Return what to change in a map if a log has no values of a quantity."""
    if name == "velocity":
        return "if the log has no velocities, set velocity = 'derive' and remove [read.velocity]"
    if name in ("time", "position", "command"):
        return f"name another column in [read.{name}]"
    return f"remove [signals.{name}], or name another column there"


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
            if name == "command":
                remedy = "if it is logged only when it changes, repeat the last one in these rows; else remove them"
            elif name in recording.signals:
                remedy = f"if it is logged less often, repeat the last one in these rows; else remove [signals.{name}]"
            if bad.all():
                what, remedy = f"the {name} is empty, NaN or infinite in all rows", name_absent(name)
            found.append(AuditFinding("not_finite", recording.label, what, remedy, rows, error=True))
    return found
