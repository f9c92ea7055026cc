"""Contacts: shapes of the model that penetrate in measured poses."""

from nas_data.count_of import join_items
from nas_data.gap.finding.audits.base import Examined, format_percent
from nas_data.gap.report_parts import Check

NAME = "contacts"
SHOWN = 3  # pairs of bodies that are named


def check(examined: Examined) -> Check:
    """Report bodies of the model that penetrate in measured poses."""
    found = sorted(examined.overlaps, key=lambda overlap: (-overlap.share, -overlap.depth))
    if not found:
        return Check(NAME, "Nowhere does the measured arm go through what the model touches.")
    each = [
        f"{one.text} by up to {1000 * one.depth:.0f} mm in {format_percent(one.share)} of the rows" for one in found
    ]
    more = [f"{len(each) - SHOWN} more pairs"] if len(each) > SHOWN else []
    return Check(
        NAME,
        f"Where the arm was measured, shapes of the model lie in each other: {join_items([*each[:SHOWN], *more])}. "
        "It moves as if they did not touch. These contacts are left out of the search and of the model that it writes; "
        "check the zeros of the joints, what the arm stands on, and the model's shapes.",
        ok=False,
    )
