"""What is looked at before physics: each file of the folder is one thing that would otherwise pass for an effect.

Where no model is needed to see it, the file sums up what the audits of every recording (`dataset/audits/`) found.
"""

from typing import Protocol, cast

from nas_data import registry
from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.report_parts import Check

FIRST = ("timing", "repeated_samples", "command_shift", "velocities", "readings")  # time before everything else


class GapAudit(Protocol):
    """What a file of this folder defines."""

    def check(self, examined: Examined) -> Check:
        """Look at one recording."""


def find_audit(name: str) -> GapAudit:
    """Return an audit by its name."""
    return cast(GapAudit, registry.module("gap.finding.audits", name, "audit"))


def run_audits(examined: Examined) -> tuple[Check, ...]:
    """Run every audit, those of time first."""
    names = [*FIRST, *(name for name in registry.names("gap.finding.audits") if name not in FIRST)]
    return tuple(find_audit(name).check(examined) for name in names)
