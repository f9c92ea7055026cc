"""Audits of a recording before the search; each file checks one error that may look like an effect.

Files that need no model summarise the audits of every recording (`dataset/audits/`).
"""

from typing import Protocol, cast

from nas_data import registry
from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.report_parts import Check

FIRST = ("timing", "repeated_samples", "command_shift", "velocities", "readings")  # run first, in this order


class GapAudit(Protocol):
    """Interface of a file in this folder."""

    def check(self, examined: Examined) -> Check:
        """Check one recording."""


def find_audit(name: str) -> GapAudit:
    """Return an audit by its name."""
    return cast(GapAudit, registry.import_plugin("gap.finding.audits", name, "audit"))


def run_audits(examined: Examined) -> tuple[Check, ...]:
    """Run every audit, those of `FIRST` first."""
    names = [*FIRST, *(name for name in registry.list_names("gap.finding.audits") if name not in FIRST)]
    return tuple(find_audit(name).check(examined) for name in names)
