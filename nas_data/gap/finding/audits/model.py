"""Model: what of it is simulated otherwise than it was handed over."""

from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.report_parts import Check

NAME = "model"


def check(examined: Examined) -> Check:
    """Repeat what was said when the model was loaded."""
    notes = examined.nominal.notes
    return Check(NAME, " ".join(notes) or "It is simulated as it was handed over.", ok=not notes)
