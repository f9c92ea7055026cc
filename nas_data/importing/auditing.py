"""Audits of a log against its map."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nas_data.dataset import audits
from nas_data.dataset.audits.base import AuditFinding, Expected
from nas_data.dataset.recording import Recording
from nas_data.importing.calibration import RANGE
from nas_data.importing.conversion import NORMALISED
from nas_data.importing.map import LogQuantity, Map
from nas_data.importing.reading import SUFFIXES

SMALLEST_LIKELY = 3.5  # [°] a log whose values are all smaller is in radians
AT_REST = 0.02  # [°] a log that spans less contains no motion
SMALL_SHARE = 0.02  # share of its range that a normalised joint exceeds; π rad are 1.6 % of −100 … 100
REST_SHARE = 0.0025  # share of its range that a normalised joint at rest does not leave


def audit(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Run all audits over a recording before resampling and alignment.

    Returns:
        Findings; errors that the map allows are warnings.
    """
    expected = make_expected(mapping)
    found = audits.run(audits.FIRST, recording, expected)
    if not any(finding.error for finding in found):
        found += [*check_degrees(recording, mapping), *check_normalised(recording, mapping)]
        found += audits.run(audits.list_remaining_audits(), recording, expected)
    return allow(found, mapping)


def allow(findings: Sequence[AuditFinding], mapping: Map) -> list[AuditFinding]:
    """Return findings with the errors that the map allows as warnings."""
    allowed = mapping.thresholds.allow
    return [replace(finding, error=finding.error and finding.check not in allowed) for finding in findings]


def make_expected(mapping: Map) -> Expected:
    """Return the audits' expectations from a map."""
    kinds = mapping.command.conversion.kinds
    return Expected(
        rate=mapping.rate,
        max_speed=mapping.thresholds.max_speed,
        jitter=mapping.thresholds.jitter,
        limits=mapping.limits,
        slides=mapping.slides,
        kinds={joint: SUFFIXES[kind] for joint, kind in zip(mapping.joints, kinds, strict=True)},
        resampled=mapping.resample is not None,
        derived=mapping.derive_velocity,
        promise="the map says" if mapping.remedies is None else "the dataset's rate is",
        remedies=mapping.remedies,
    )


def check_degrees(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Return errors for quantities in degrees whose values are so small that they are likely radians."""
    found = []
    for quantity, values in ((mapping.position, recording.positions), (mapping.command, recording.commands)):
        in_degrees = [unit == "deg" for unit in quantity.conversion.units]
        degrees = quantity.conversion.raw(values)[:, in_degrees]  # shape (N, k)
        if not degrees.size or np.ptp(degrees, axis=0).max() < AT_REST or np.abs(degrees).max() > SMALLEST_LIKELY:
            continue
        if quantity is mapping.command and not _contradicts_small_commands(recording, quantity):
            continue
        what = (
            f"the {quantity.name} of all joints is within ±{np.abs(degrees).max():.3g} as logged: in degrees, the "
            "robot would hardly have moved"
        )
        remedy = _name_remedies(mapping, f"unit = 'rad' in [read.{quantity.name}]", "degrees")
        found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=True))
    return found


def check_normalised(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Return errors for normalised joints that stay near the raw zero, so that their values are likely radians.

    All joints of a log are in radians or none is. So a joint in degrees, or another normalised joint, that moves
    further shows that a small one, such as a closed gripper, moved that little.
    """
    conversion = mapping.position.conversion
    raw = conversion.raw(recording.positions)
    sizes, ways = np.abs(raw).max(axis=0), np.ptp(raw, axis=0)
    spans = np.where(np.array(conversion.units) == NORMALISED, conversion.spans, 0.0)
    largest = np.where(spans > 0, SMALL_SHARE * spans, SMALLEST_LIKELY)
    shown = [unit in ("deg", RANGE, NORMALISED) for unit in conversion.units]
    if (sizes > largest)[shown].any():
        return []
    small = (spans > 0) & (ways > REST_SHARE * spans)
    found = []
    for joint, size, span in zip(*(np.array(part)[small] for part in (mapping.joints, sizes, spans)), strict=True):
        what = (
            f"the position of {joint} is within ±{size:.3g} as logged, although it moves: in its normalised range of "
            f"{span:g}, it would hardly have moved"
        )
        remedy = _name_remedies(mapping, f"unit = 'rad' in [read.position.joints.{joint}]", "normalised")
        found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=True))
    return found


def _name_remedies(mapping: Map, key: str, unit: str) -> str:
    """Return what to do if values are radians, or if they have the unit of the map after all."""
    radians = "--unit rad" if mapping.layout.format == "lerobot" else key
    own = f"{mapping.remedies.elsewhere} " if mapping.remedies and mapping.remedies.elsewhere else ""
    return f"if these are radians, use {radians}; if they are {unit}, {own}add allow = ['unit_slip'] to [audit]"


def _contradicts_small_commands(recording: Recording, command: LogQuantity) -> bool:
    """Return whether small commands are implausible: all are positions, or a joint in degrees moves further."""
    if set(command.conversion.kinds) == {"position"}:
        return True
    in_degrees = [unit == "deg" for unit in command.conversion.units]
    return bool(np.abs(np.degrees(recording.positions[:, in_degrees])).max() > SMALLEST_LIKELY)
