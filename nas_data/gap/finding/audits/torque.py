"""Torque off: rows in which the servos were switched off."""

from nas_data.gap.finding.audits.base import Examined, format_percent
from nas_data.gap.finding.torque_off import TORQUE, find_torque_on
from nas_data.gap.report_parts import Check

NAME = "torque off"


def check(examined: Examined) -> Check:
    """Report how many rows are left out."""
    dataset = examined.dataset
    if TORQUE not in dataset.columns:
        return Check(NAME, "The recording does not say whether the servos were powered; they are taken to be.")
    off = ~find_torque_on(dataset)
    if not off.any():
        return Check(NAME, "The servos were powered in every row.")
    episodes = sum(bool(off[rows].any()) for rows in dataset.episodes())
    kept = int(examined.recorded.evidence.mask.sum())
    noun = "episode" if episodes == 1 else "episodes"
    return Check(
        NAME,
        f"The torque is off in {format_percent(float(off.mean()))} of the rows, in {episodes} {noun}: "
        f"each episode is cut to its longest stretch with the torque on, "
        f"which leaves {kept} of {dataset.n_frames} rows.",
    )
