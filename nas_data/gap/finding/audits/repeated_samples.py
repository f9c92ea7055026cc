"""Repeated samples: readings that do not change in motion, because the device is slower than the recorder."""

from nas_data.gap.finding.audits.base import Examined, summarise_audits
from nas_data.gap.report_parts import Check

NAME = "repeated samples"


def check(examined: Examined) -> Check:
    """Report readings that repeat earlier ones."""
    return summarise_audits(
        NAME, examined, ("repeated_samples", "frozen_reading"), "No reading repeats the one before while the arm moves."
    )
