"""Audits of a log against its map."""

from dataclasses import replace

from nas_data.dataset import audits
from nas_data.dataset.audits.base import AuditFinding, Expected
from nas_data.dataset.recording import Recording
from nas_data.importing import degrees
from nas_data.importing.map import Map


def audit(recording: Recording, mapping: Map) -> list[AuditFinding]:
    """Run all audits over a recording before resampling and alignment.

    Returns:
        Findings; errors that the map allows are warnings.
    """
    expected = expected_of(mapping)
    found = audits.run(audits.FIRST, recording, expected)
    if not any(finding.error for finding in found):
        found += [*degrees.check(recording, mapping), *audits.run(audits.others(), recording, expected)]
    allowed = mapping.thresholds.allow
    return [replace(finding, error=finding.error and finding.check not in allowed) for finding in found]


def expected_of(mapping: Map) -> Expected:
    """Return the expectations of a map for the audits."""
    return Expected(
        rate=mapping.rate,
        max_speed=mapping.thresholds.max_speed,
        jitter=mapping.thresholds.jitter,
        limits=mapping.limits,
        slides=mapping.slides,
        effort=not mapping.commands_positions,
        resampled=mapping.resample is not None,
        derived=mapping.derive_velocity,
        promise="the map says",
    )
