"""What cannot be decided from a recording, whatever is fitted to it, and what to record instead."""

from collections.abc import Sequence

import numpy as np

from nas_data.gap.finding.audits.excitation import constant, find_unmoved_joints, names
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.finding.significance import episodes_needed
from nas_data.gap.report_parts import Bin

SHORT = 5.0  # [s] of recording below which little can be told
RATES = 0.02  # relative difference between the rates of episodes


def undecidable(recorded: RecordedRows, floor: np.ndarray, regimes: Sequence[Bin]) -> tuple[str, ...]:
    """Return one sentence for each thing that cannot be decided, with the remedy."""
    said = [*about_motion(recorded, floor), *about_time(recorded), *about_episodes(recorded, regimes)]
    return tuple(said)


def about_motion(recorded: RecordedRows, floor: np.ndarray) -> list[str]:
    """Say about which joints nothing can be told."""
    evidence = recorded.evidence
    still = find_unmoved_joints(evidence, floor)
    if still.all():
        return ["No joint moves in any episode, so no gap can be explained: record the arm in motion."]
    steady = constant(evidence)
    said = []
    if steady.any():
        said.append(
            f"What is missing at {names(evidence, steady)} cannot be decided, because its command never changes: "
            "record commands that move it."
        )
    if (still & ~steady).any():
        said.append(
            f"{names(evidence, still & ~steady)} never moves although it is commanded to, so no effect there can be "
            "told from a servo that is released, stuck or not connected."
        )
    return said


def about_time(recorded: RecordedRows) -> list[str]:
    """Say where the recording is too short, or has several rates."""
    said = []
    seconds = float(recorded.evidence.mask.sum()) * recorded.evidence.period
    if seconds < SHORT:
        said.append(f"The recording lasts {seconds:.2g} s, which is too short to tell effects apart: record a minute.")
    steps = periods(recorded)
    if steps is not None:
        rates = episode_rates(recorded, steps)
        if rates.max() / rates.min() > 1 + RATES:
            hertz = rates / recorded.evidence.period
            said.append(
                f"Episodes run at different rates, {hertz.min():.4g} to {hertz.max():.4g} Hz by their clock, so delays "
                "and speeds cannot be decided: divide the dataset by rate, or import it with [resample]."
            )
    return said


def periods(recorded: RecordedRows) -> np.ndarray | None:
    """Return the time between rows in control periods, shape (E, T − 1); None without a clock."""
    if recorded.times is None:
        return None
    return np.asarray(np.diff(recorded.times, axis=1) / recorded.evidence.period)


def episode_rates(recorded: RecordedRows, steps: np.ndarray) -> np.ndarray:
    """Return each episode's rate over the dataset's, shape (E,)."""
    pairs = zip(steps, recorded.evidence.mask[:, 1:], strict=True)
    medians = [float(np.median(row[seen])) if seen.any() else 1.0 for row, seen in pairs]
    return 1 / np.maximum(np.array(medians), 1e-3)


def about_episodes(recorded: RecordedRows, regimes: Sequence[Bin]) -> list[str]:
    """Say where there are too few episodes."""
    tested = sum(measured.chance < 1 for measured in regimes)
    count, needed = len(recorded.evidence), episodes_needed(tested)
    if count < 2:
        return ["There is one episode only, so nothing can be checked on another: record several, or divide it."]
    if tested and count < needed:
        return [
            f"In which regimes the gap is larger cannot be decided beyond chance from {count} episodes; "
            f"{needed} would be enough."
        ]
    return []
