"""Audits of a log against its map."""

from dataclasses import replace

import numpy as np

from nas_data.dataset import audits
from nas_data.dataset.audits.base import AuditFinding, Expected
from nas_data.dataset.recording import Recording
from nas_data.importing.map import LogQuantity, Map
from nas_data.importing.reading import SUFFIXES

SMALLEST_LIKELY = 3.5  # [°] a log whose values are all smaller is in radians
AT_REST = 0.02  # [°] a log that spans less contains no motion


def audit(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Run all audits over a recording before resampling and alignment.

    Returns:
        Findings; errors that the map allows are warnings.
    """
    expected = make_expected(mapping)
    found = audits.run(audits.FIRST, recording, expected)
    if not any(finding.error for finding in found):
        found += [*check_degrees(recording, mapping), *audits.run(audits.list_remaining_audits(), recording, expected)]
    allowed = mapping.thresholds.allow
    return [replace(finding, error=finding.error and finding.check not in allowed) for finding in found]


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
        radians = "--unit rad" if mapping.layout.format == "lerobot" else f"unit = 'rad' in [read.{quantity.name}]"
        own = f"{mapping.remedies.elsewhere} " if mapping.remedies and mapping.remedies.elsewhere else ""
        remedy = f"if these are radians, use {radians}; if they are degrees, {own}add allow = ['unit_slip'] to [audit]"
        found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=True))
    return found


def _contradicts_small_commands(recording: Recording, command: LogQuantity) -> bool:
    """Return whether small commands are implausible: all are positions, or a joint in degrees moves further."""
    if set(command.conversion.kinds) == {"position"}:
        return True
    in_degrees = [unit == "deg" for unit in command.conversion.units]
    return bool(np.abs(np.degrees(recording.positions[:, in_degrees])).max() > SMALLEST_LIKELY)
