"""Audits of a log against its map."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nas_data.dataset import audits
from nas_data.dataset.audits.base import AuditFinding, Expected, Remedies
from nas_data.dataset.recording import Recording
from nas_data.importing.calibration import RANGE
from nas_data.importing.conversion import NORMALISED
from nas_data.importing.joining import BY_RECEIPT
from nas_data.importing.map import LogQuantity, Map
from nas_data.importing.reading import SUFFIXES
from nas_data.importing.resampling import take_last_of_time

SMALLEST_LIKELY = 3.5  # [°] a log whose values are all smaller is in radians
AT_REST = 0.02  # [°] a log that spans less contains no motion
SMALL_SHARE = 0.02  # share of its range that a normalised joint exceeds; π rad are 1.6 % of −100 … 100
REST_SHARE = 0.0025  # share of its range that a normalised joint at rest does not leave
OF_TOPICS = Remedies({"time_backwards": BY_RECEIPT})


def audit(recordings: Sequence[Recording], mapping: Map) -> list[AuditFinding]:
    """Run all audits over recordings before resampling and alignment.

    Of rows with equal time, resampling uses the last. So all audits after those of time and finite values see that one.

    Returns:
        Findings; errors that the map allows are warnings.
    """
    expected = make_expected(mapping)
    found: list[AuditFinding] = []
    sound = []
    for recording in recordings:
        first = audits.run(audits.FIRST, recording, expected)
        found += first
        if not any(finding.error for finding in first):
            sound.append(take_last_of_time(recording) if mapping.resample else recording)
    found += [*check_degrees(sound, mapping), *check_normalised(sound, mapping)]
    for recording in sound:
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
        remedies=mapping.remedies or (OF_TOPICS if mapping.layout.topics else None),
    )


def check_degrees(recordings: Sequence[Recording], mapping: Map) -> list[AuditFinding]:
    """Return findings on quantities in degrees whose values are so small that they are likely radians.

    A log in which another episode has larger values is in degrees. If another log has, the finding is a warning.
    """
    found = []
    for quantity in (mapping.position, mapping.command):
        in_degrees = [unit == "deg" for unit in quantity.conversion.units]
        raw = [
            quantity.conversion.raw(recording.positions if quantity is mapping.position else recording.commands)
            for recording in recordings
        ]
        episodes = [(recording, values[:, in_degrees]) for recording, values in zip(recordings, raw, strict=True)]
        episodes = [(recording, degrees) for recording, degrees in episodes if degrees.size]  # shape (N, k)
        shown = {recording.file for recording, degrees in episodes if np.abs(degrees).max() > SMALLEST_LIKELY}
        for recording, degrees in episodes:
            if recording.file in shown or np.ptp(degrees, axis=0).max() < AT_REST:
                continue
            if quantity is mapping.command and not _contradicts_small_commands(recording, quantity):
                continue
            what = (
                f"the {quantity.name} of all joints is within ±{np.abs(degrees).max():.3g} as logged: in degrees, the "
                "robot would hardly have moved"
            )
            remedy = _name_remedies(mapping, f"unit = 'rad' in [read.{quantity.name}]", "degrees")
            found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=not shown))
    return found


def check_normalised(recordings: Sequence[Recording], mapping: Map) -> list[AuditFinding]:
    """Return findings on normalised joints that stay near the raw zero, so that their values are likely radians.

    All joints of a log are in radians or none is. So a joint in degrees, or another normalised joint, that moves
    further shows that a small one, such as a closed gripper, moved that little. If only another log shows it, the
    finding is a warning.
    """
    conversion = mapping.position.conversion
    spans = np.where(np.array(conversion.units) == NORMALISED, conversion.spans, 0.0)
    largest = np.where(spans > 0, SMALL_SHARE * spans, SMALLEST_LIKELY)
    telling = [unit in ("deg", RANGE, NORMALISED) for unit in conversion.units]
    raw = [conversion.raw(recording.positions) for recording in recordings]
    episodes = [
        (one, np.abs(values).max(axis=0), np.ptp(values, axis=0)) for one, values in zip(recordings, raw, strict=True)
    ]
    shown = {recording.file for recording, sizes, _ in episodes if (sizes > largest)[telling].any()}
    found = []
    for recording, sizes, ways in episodes:
        small = (spans > 0) & (ways > REST_SHARE * spans)
        if recording.file in shown:
            continue
        for joint, size, span in zip(*(np.array(part)[small] for part in (mapping.joints, sizes, spans)), strict=True):
            what = (
                f"the position of {joint} is within ±{size:.3g} as logged, although it moves: in its normalised range "
                f"of {span:g}, it would hardly have moved"
            )
            remedy = _name_remedies(mapping, f"unit = 'rad' in [read.position.joints.{joint}]", "normalised")
            found.append(AuditFinding("unit_slip", recording.label, what, remedy, error=not shown))
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
