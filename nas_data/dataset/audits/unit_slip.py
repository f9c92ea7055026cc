"""Unit slips: angles that no joint reaches, because they are degrees or ticks read as radians."""

import numpy as np

from nas_data.dataset.audits.base import Expected, Finding, row_numbers
from nas_data.dataset.recording import Recording
from nas_data.dataset.rows import rows_text

LARGEST = 4 * np.pi  # [rad]; two turns, more than any joint of an arm makes
BEYOND = 0.5  # share of the range by which a measured position cannot exceed its limits


def check(recording: Recording, expected: Expected) -> list[Finding]:
    """Refuse positions and commands that cannot be radians."""
    found = [] if expected.turns else _too_large(recording, "position", recording.positions)
    if not expected.effort and not expected.turns:
        found += _too_large(recording, "command", recording.commands)
    return found or _far_beyond(recording, expected)


def _too_large(recording: Recording, what: str, values: np.ndarray) -> list[Finding]:
    found = []
    for index, joint in enumerate(recording.joints):
        size = np.abs(values[:, index])
        rows = row_numbers(recording.rows, size > LARGEST)
        if rows:
            text = f"the {what} of {joint} reaches {size.max():.4g} rad in {rows_text(rows)}, more than two turns"
            remedy = (
                f"if the log is in degrees or ticks, say so: unit in [read.{what}]; if the joint does turn so far, "
                "add allow = ['unit_slip'] to [audit]"
            )
            found.append(Finding("unit_slip", recording.place, text, remedy, rows, error=True))
    return found


def _far_beyond(recording: Recording, expected: Expected) -> list[Finding]:
    """A joint cannot turn far beyond its limits: the number must mean something else."""
    found = []
    for joint, (low, high) in expected.limits.items():
        values = recording.positions[:, recording.joints.index(joint)]
        excess = np.maximum(values - high, low - values)
        rows = row_numbers(recording.rows, excess > BEYOND * (high - low))
        if rows:
            what = (
                f"the position of {joint} is {excess.max():.3g} rad beyond its limits {low:.4g} … {high:.4g} rad in "
                f"{rows_text(rows)}"
            )
            remedy = "if the log is in degrees or ticks, say so: unit in [read.position]"
            found.append(Finding("unit_slip", recording.place, what, remedy, rows, error=True))
    return found
