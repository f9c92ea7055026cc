"""Audits of recordings: each file of the folder checks one thing and reports it by row."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, cast

from nas_data import registry
from nas_data.importing.finding import Finding
from nas_data.importing.map import Map
from nas_data.importing.recording import Recording

FIRST = ("finite", "timing")  # the others need finite values in rows whose time goes on


class Audit(Protocol):
    """What a file of this folder defines."""

    def check(self, recording: Recording, mapping: Map) -> list[Finding]:
        """Look at one recording as it was recorded: in SI, nothing resampled, commands in their own rows."""


def find_audit(name: str) -> Audit:
    """Return an audit by its name."""
    return cast(Audit, registry.module("importing.audits", name, "audit"))


def audit(recording: Recording, mapping: Map) -> list[Finding]:
    """Run every audit on a recording.

    Returns:
        Findings; errors that the map allows have become warnings. Where values or times are unusable, only that is
        reported, because everything else would follow from it.
    """
    found = _run(FIRST, recording, mapping)
    if any(finding.error for finding in found):
        return found
    return found + _run([name for name in registry.names("importing.audits") if name not in FIRST], recording, mapping)


def _run(names: Sequence[str], recording: Recording, mapping: Map) -> list[Finding]:
    found = [finding for name in names for finding in find_audit(name).check(recording, mapping)]
    allowed = mapping.thresholds.allow
    return [replace(finding, error=finding.error and finding.check not in allowed) for finding in found]
