"""Torque off: rows in which the servos were released, which no command explains."""

from nas_data.gap.finding.audits.base import Examined, percent
from nas_data.gap.finding.torque_off import TORQUE, torque_on
from nas_data.gap.report_parts import Check

NAME = "torque off"


def check(examined: Examined) -> Check:
    """Say how many rows are left out, and why."""
    dataset = examined.dataset
    if TORQUE not in dataset.columns:
        return Check(NAME, "The recording does not say whether the servos were powered; they are taken to be.")
    off = ~torque_on(dataset)
    if not off.any():
        return Check(NAME, "The servos were powered in every row.")
    episodes = sum(bool(off[rows].any()) for rows in dataset.episodes())
    kept = int(examined.recorded.evidence.mask.sum())
    noun = "episode" if episodes == 1 else "episodes"
    return Check(
        NAME,
        f"The torque is off in {percent(float(off.mean()))} of the rows, in {episodes} {noun}: each episode is cut to "
        f"its longest stretch with the torque on, which leaves {kept} of {dataset.n_frames} rows.",
    )
