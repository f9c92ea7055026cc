"""Velocities: consistency of recorded velocities with positions, in size and time."""

from nas_data.dataset.recording import has_derived_velocities
from nas_data.gap.finding.audits.base import Examined, summarise_audits
from nas_data.gap.report_parts import Check

NAME = "velocities"
CHECKS = ("velocity_scale", "velocity_lag", "position_contradicts_velocity")


def check(examined: Examined) -> Check:
    """Report joints whose velocities do not match their positions."""
    if has_derived_velocities(examined.dataset):
        return Check(NAME, "Velocities were derived from the positions; one-step errors carry their noise.")
    advice = "one-step predictions start where the arm never was: import again with velocity = 'derive'"
    sound = "The recorded velocities are those of the positions, in size and in time."
    return summarise_audits(NAME, examined, CHECKS, sound, advice)
