"""Readings: jumps and wraps, units, signs, and joints that follow another joint's command."""

from nas_data.gap.finding.audits.base import Examined, summarise_audits
from nas_data.gap.report_parts import Check

NAME = "readings"
CHECKS = ("jump", "unit_slip", "command_scale", "command_sign", "command_is_position", "joints_swapped")


def check(examined: Examined) -> Check:
    """Say which readings and commands cannot be what they are called."""
    return summarise_audits(NAME, examined, CHECKS, "No reading jumps, and positions and commands belong together.")
