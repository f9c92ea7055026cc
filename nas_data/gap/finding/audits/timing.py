"""Timing: late rows, and a clock with another rate than the dataset."""

from nas_data.dataset.features import TIME
from nas_data.gap.finding.audits.base import Examined, summarise_audits
from nas_data.gap.report_parts import Check

NAME = "timing"
CHECKS = ("time_backwards", "repeated_time", "rate", "irregular_time", "time_gap")


def check(examined: Examined) -> Check:
    """Report where the recorder's clock contradicts evenly spaced rows."""
    if TIME not in examined.dataset.columns:
        return Check(NAME, "The recorder's clock was not kept (nas.time): rows are taken as evenly spaced.")
    advice = (
        "import the recording again with [resample] in its map, or with --uniform a LeRobot dataset of which only the "
        "time stamps are uneven"
    )
    return summarise_audits(NAME, examined, CHECKS, "The rows came evenly, at the dataset's rate.", advice)
