"""Wrong units: values that no joint reaches, because degrees were read as radians, millimetres as metres, or ticks."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.features import POSITION
from nas_data.dataset.joints import LARGEST_ANGLE, LARGEST_LENGTH
from nas_data.dataset.recording import Recording
from nas_data.joint_units import find_joint_unit

LARGEST_POSITIONS = {  # by whether a joint is a slide: largest position, the same in words, likely unit of the log
    False: (LARGEST_ANGLE, "two turns", "degrees or ticks"),
    True: (LARGEST_LENGTH, "any arm's slide goes", "millimetres or ticks"),
}
LIMIT_EXCESS_SHARE = 0.5  # share of the range by which a position cannot exceed its limits


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse positions and commands that cannot be in their stated unit."""
    found = []
    if not expected.turns:
        found += _report_large_values(recording, expected, "position", recording.positions)
        # Speed and torque commands have no largest plausible value.
        angles = np.where(expected.find_commanded(recording.joints, POSITION), recording.commands, 0.0)
        found += _report_large_values(recording, expected, "command", angles)
    return found or _report_limit_excess(recording, expected)


def _report_large_values(recording: Recording, expected: Expected, what: str, values: np.ndarray) -> list[AuditFinding]:
    found = []
    for index, joint in enumerate(recording.joints):
        size = np.abs(values[:, index])
        most, words, units = LARGEST_POSITIONS[joint in expected.slides]
        rows = list_row_numbers(recording.rows, size > most)
        if rows:
            unit = find_joint_unit(joint, expected.slides).si
            text = (
                f"the {what} of {joint} reaches {size.max():.4g} {unit} in {recording.name_rows(rows)}, "
                f"more than {words}"
            )
            remedy = (
                f"if the log is in {units}, correct {_name_key(what, joint)}; if the joint does move that far, add "
                "allow = ['unit_slip'] to [audit]"
            )
            found.append(AuditFinding("unit_slip", recording.label, text, remedy, rows, error=True))
    return found


def _name_key(what: str, joint: str) -> str:
    """Return the map's key for the unit; a joint may have a table of its own."""
    return f"the unit in [read.{what}], or in [read.{what}.joints.{joint}] where the map has it"


def _report_limit_excess(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report positions far beyond the joint's limits, which must have another unit."""
    found = []
    for joint, (low, high) in expected.limits.items():
        values = recording.positions[:, recording.joints.index(joint)]
        excess = np.maximum(values - high, low - values)
        rows = list_row_numbers(recording.rows, excess > LIMIT_EXCESS_SHARE * (high - low))
        if rows:
            unit, units = find_joint_unit(joint, expected.slides).si, LARGEST_POSITIONS[joint in expected.slides][2]
            what = (
                f"the position of {joint} is {excess.max():.3g} {unit} beyond its limits {low:.4g} … {high:.4g} {unit} "
                f"in {recording.name_rows(rows)}"
            )
            remedy = f"if the log is in {units}, correct {_name_key('position', joint)}"
            found.append(AuditFinding("unit_slip", recording.label, what, remedy, rows, error=True))
    return found
