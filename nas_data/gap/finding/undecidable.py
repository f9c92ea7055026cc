"""Questions that a recording cannot decide, and what to record instead."""

from collections.abc import Sequence

import numpy as np

from nas_data.count_of import count_of
from nas_data.gap.finding.audits import find_constant_commands, find_unmoved_joints, join_chosen
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.finding.regimes import count_episodes_needed
from nas_data.gap.report_parts import Bin

SHORT = 5.0  # [s] duration below which effects cannot be distinguished
RATES = 0.02  # relative difference above which episodes have different rates


def list_undecidable(recorded: RecordedRows, floor: np.ndarray, regimes: Sequence[Bin]) -> tuple[str, ...]:
    """Return a sentence for each question that cannot be decided, with the remedy."""
    said = [*check_motion(recorded, floor), *check_time(recorded), *check_episodes(recorded, regimes)]
    return tuple(said)


def check_motion(recorded: RecordedRows, floor: np.ndarray) -> list[str]:
    """Name the joints that were not commanded or did not move."""
    evidence = recorded.evidence
    still = find_unmoved_joints(evidence, floor)
    if still.all():
        return ["No joint moves in any episode, so no gap can be explained: record the arm in motion."]
    steady = find_constant_commands(evidence)
    said = []
    if steady.any():
        said.append(
            f"What is missing at {join_chosen(evidence, steady)} cannot be decided, because its command never changes: "
            "record commands that move it."
        )
    if (still & ~steady).any():
        said.append(
            f"{join_chosen(evidence, still & ~steady)} never moves although it is commanded to, so no effect there can "
            "be told from a servo that is released, stuck or not connected."
        )
    return said


def check_time(recorded: RecordedRows) -> list[str]:
    """Report a recording that is too short or has several rates."""
    said = []
    seconds = float(recorded.evidence.mask.sum()) * recorded.evidence.period
    if seconds < SHORT:
        said.append(f"The recording lasts {seconds:.2g} s, which is too short to tell effects apart: record a minute.")
    steps = measure_periods(recorded)
    if steps is not None:
        rates = measure_rates(recorded, steps)
        if rates.max() / rates.min() > 1 + RATES:
            hertz = rates / recorded.evidence.period
            said.append(
                f"Episodes run at different rates, {hertz.min():.4g} to {hertz.max():.4g} Hz by their clock, so delays "
                "and speeds cannot be decided: divide the dataset by rate, or import it with [resample]."
            )
    return said


def measure_periods(recorded: RecordedRows) -> np.ndarray | None:
    """Return the time between rows in control periods, shape (E, T − 1); None without a clock."""
    if recorded.times is None:
        return None
    return np.asarray(np.diff(recorded.times, axis=1) / recorded.evidence.period)


def measure_rates(recorded: RecordedRows, steps: np.ndarray) -> np.ndarray:
    """Return each episode's rate over the dataset's, shape (E,)."""
    pairs = zip(steps, recorded.evidence.mask[:, 1:], strict=True)
    medians = [float(np.median(row[seen])) if seen.any() else 1.0 for row, seen in pairs]
    return 1 / np.maximum(np.array(medians), 1e-3)


def check_episodes(recorded: RecordedRows, regimes: Sequence[Bin]) -> list[str]:
    """Report too few episodes."""
    tested = sum(measured.chance < 1 for measured in regimes)
    count, needed = len(recorded.evidence), count_episodes_needed(tested)
    if count < 2:
        return ["There is one episode only, so nothing can be checked on another: record several, or divide it."]
    if tested and count < needed:
        return [
            f"In which regimes the gap is larger cannot be decided beyond chance from {count_of(count, 'episode')}; "
            f"{needed} would be enough."
        ]
    return []
