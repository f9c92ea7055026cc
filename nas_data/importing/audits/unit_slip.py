"""Unit slips: degrees read as radians, radians read as degrees, millimetres read as metres."""

import numpy as np

from nas_data.dataset.joints import LARGEST_LENGTH
from nas_data.importing.finding import Finding, row_numbers
from nas_data.importing.map import Map, Quantity
from nas_data.importing.recording import Recording
from nas_data.importing.rows import rows_text
from nas_data.joint_units import joint_unit

LARGEST = 4 * np.pi  # [rad]; two turns, more than any joint of an arm makes
FURTHEST = {  # by whether a joint is a slide: how far it goes at most, in words too, and what else the log may hold
    False: (LARGEST, "two turns", "degrees or ticks"),
    True: (LARGEST_LENGTH, "any arm's slide goes", "millimetres or ticks"),
}
BEYOND = 0.5  # share of the range by which a measured position cannot exceed its limits
SMALLEST_LIKELY = 3.5  # [°]; a whole log within this many degrees of zero holds radians
AT_REST = 0.02  # [°]; a log that spans less does not move, whatever its unit


def check(recording: Recording, mapping: Map) -> list[Finding]:
    """Refuse positions and commands that cannot be what the map says they are."""
    found = _too_large(recording, mapping, "position", recording.positions)
    if not mapping.commands_effort:
        found += _too_large(recording, mapping, "command", recording.commands)
    if not found:
        found = _far_beyond(recording, mapping)
    return found + _too_small(recording, mapping)


def _too_large(recording: Recording, mapping: Map, what: str, values: np.ndarray) -> list[Finding]:
    found = []
    for index, joint in enumerate(recording.joints):
        size = np.abs(values[:, index])
        most, told, units = FURTHEST[joint in mapping.slides]
        rows = row_numbers(recording.rows, size > most)
        if rows:
            message = (
                f"the {what} of {joint} reaches {size.max():.4g} {joint_unit(joint, mapping.slides).si} in "
                f"{rows_text(rows)}, more than {told}; if the log is in {units}, say so: unit in [read.{what}]."
            )
            found.append(Finding("unit_slip", recording.place, message, rows, error=True))
    return found


def _far_beyond(recording: Recording, mapping: Map) -> list[Finding]:
    """A joint cannot turn far beyond its limits: the number must mean something else."""
    found = []
    for joint, (low, high) in mapping.limits.items():
        values = recording.positions[:, recording.joints.index(joint)]
        excess = np.maximum(values - high, low - values)
        rows = row_numbers(recording.rows, excess > BEYOND * (high - low))
        if rows:
            unit, units = joint_unit(joint, mapping.slides).si, FURTHEST[joint in mapping.slides][2]
            message = (
                f"the position of {joint} is {excess.max():.3g} {unit} beyond its limits {low:.4g} … {high:.4g} {unit} "
                f"in {rows_text(rows)}; if the log is in {units}, say so: unit in [read.position]."
            )
            found.append(Finding("unit_slip", recording.place, message, rows, error=True))
    return found


def _too_small(recording: Recording, mapping: Map) -> list[Finding]:
    """Numbers that all lie within a few degrees of zero, in every joint, are radians."""
    read = [(mapping.position, recording.positions)]
    if not mapping.commands_effort:
        read.append((mapping.command, recording.commands))
    found = []
    for quantity, values in read:
        degrees = _logged_degrees(quantity, values)
        if not degrees.size or np.ptp(degrees, axis=0).max() < AT_REST or np.abs(degrees).max() > SMALLEST_LIKELY:
            continue
        message = (
            f"the {quantity.name} stays within {np.abs(degrees).max():.3g} as logged, in all joints: as degrees the "
            f"robot hardly moved; if these are radians, say unit = 'rad' in [read.{quantity.name}], "
            "if they are degrees, add allow = ['unit_slip'] to [audit]."
        )
        found.append(Finding("unit_slip", recording.place, message, error=True))
    return found


def _logged_degrees(quantity: Quantity, values: np.ndarray) -> np.ndarray:
    """Return the numbers that the log gives in degrees, shape (N, k)."""
    in_degrees = [unit == "deg" for unit in quantity.conversion.units]
    return quantity.conversion.raw(values)[:, in_degrees]
