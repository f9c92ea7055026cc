"""Timing: rows that came late, and a clock that runs at another rate than the dataset says."""

import numpy as np

from nas_data.gap.finding.audits.base import Check, Examined, percent
from nas_data.gap.finding.recorded import Recorded

NAME = "timing"
LATE = 0.5  # periods by which a step must differ to count as late or early
TOLERATED = 0.01  # share of such rows that no fit notices
RATE = 0.01  # relative difference of the rate that is worth a word: a delay that grows by 10 ms a second


def check(examined: Examined) -> Check:
    """Compare the recorder's clock with evenly spaced rows."""
    recorded = examined.recorded
    steps = periods(recorded)
    if steps is None:
        return Check(NAME, "The recorder's clock was not kept (nas.time): rows are taken as evenly spaced.")
    rates = episode_rates(recorded, steps)
    late = np.abs(steps - 1) > LATE
    seen = recorded.evidence.counts[:, 1:]
    share = float(late[seen].mean()) if seen.any() else 0.0
    worst = float(np.abs(steps[seen] - 1).max(initial=0.0)) * recorded.evidence.period * 1e3
    found = [f"{percent(share)} of the rows are more than half a period late or early (at most {worst:.2f} ms)"]
    off = np.abs(rates - 1) > RATE
    if off.any():
        hertz = rates[off] / recorded.evidence.period
        found.append(
            f"{off.sum()} of {len(rates)} episodes run at {hertz.min():.5g} to {hertz.max():.5g} Hz "
            f"instead of {1 / recorded.evidence.period:.5g} Hz"
        )
    ok = share <= TOLERATED and not off.any()
    advice = "." if ok else "; import the log again with [resample] in its map."
    return Check(NAME, ", and ".join(found) + advice, ok)


def periods(recorded: Recorded) -> np.ndarray | None:
    """Return the time between rows in control periods, shape (E, T − 1); None without a clock."""
    if recorded.times is None:
        return None
    return np.asarray(np.diff(recorded.times, axis=1) / recorded.evidence.period)


def episode_rates(recorded: Recorded, steps: np.ndarray) -> np.ndarray:
    """Return each episode's rate over the dataset's, shape (E,)."""
    pairs = zip(steps, recorded.evidence.counts[:, 1:], strict=True)
    medians = [float(np.median(row[seen])) if seen.any() else 1.0 for row, seen in pairs]
    return 1 / np.maximum(np.array(medians), 1e-3)
