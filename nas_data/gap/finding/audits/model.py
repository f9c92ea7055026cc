"""Model: deviations of the simulation from the given model."""

from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.report_parts import Check

NAME = "model"


def check(examined: Examined) -> Check:
    """Repeat the notes from loading the model."""
    notes = examined.nominal.notes
    return Check(NAME, " ".join(notes) or "It is simulated as it was handed over.", ok=not notes)
