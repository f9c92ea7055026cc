"""Limits: commands and positions outside the joint limits in the map."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.features import POSITION
from nas_data.dataset.recording import Recording
from nas_data.joint_units import find_joint_unit

TOLERANCE = 1e-6  # [rad; m] rounding of written limits and logs


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report rows beyond a limit, by joint."""
    found, positional = [], expected.find_commanded(recording.joints, POSITION)
    for index, joint in enumerate(recording.joints):
        if joint not in expected.limits:
            continue
        if positional[index]:
            found += _report_excess(recording, expected, index, "command", recording.commands[:, index])
        found += _report_excess(recording, expected, index, "position", recording.positions[:, index])
    return found


def _report_excess(
    recording: Recording, expected: Expected, index: int, what: str, values: np.ndarray
) -> list[AuditFinding]:
    joint = recording.joints[index]
    low, high = expected.limits[joint]
    excess = np.maximum(values - high, low - values)
    rows = list_row_numbers(recording.rows, excess > TOLERANCE)
    if not rows:
        return []
    unit = find_joint_unit(joint, expected.slides).si
    text = (
        f"the {what} of {joint} is up to {excess.max():.3g} {unit} beyond its limits "
        f"{low:.4g} … {high:.4g} {unit} in {recording.name_rows(rows)}"
    )
    remedy = f"correct the joint's [limits], or its unit, sign or zero in [read.{what}]"
    return [AuditFinding(f"{what}_beyond_limits", recording.label, text, remedy, rows)]
