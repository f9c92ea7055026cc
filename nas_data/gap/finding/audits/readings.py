"""Readings: jumps, wraps, units, signs, and joints with another joint's commands."""

from nas_data.gap.finding.audits.base import Examined, summarise_audits
from nas_data.gap.report_parts import Check

NAME = "readings"
CHECKS = ("jump", "unit_slip", "command_scale", "command_sign", "command_is_position", "joints_swapped")


def check(examined: Examined) -> Check:
    """Report readings and commands that contradict their name or unit."""
    return summarise_audits(NAME, examined, CHECKS, "No reading jumps, and positions and commands belong together.")
