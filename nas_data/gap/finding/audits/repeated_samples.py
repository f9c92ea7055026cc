"""Repeated samples: readings that stand still while the arm moves, because the device is slower than the recorder."""

import numpy as np

from nas_data.dataset.noise import SMALLEST, quantum
from nas_data.gap.finding.audits.base import Check, Examined, percent
from nas_data.gap.finding.recorded import Recorded

NAME = "repeated samples"
FAST = 1.5  # [quanta] a row; a joint that moves so far cannot give the same reading twice
FASTER = 0.2  # share of the largest moves a row that also counts as fast, where rounding was blurred by resampling
TOLERATED = 0.02  # share of the rows in fast motion that may repeat: a lost answer now and then
FEWEST = 20  # rows in fast motion
REGULAR = 0.7  # share of the gaps between repeats that are alike where the device has a rate of its own
DERIVED = 1e-3  # [rad/s] within which velocities are differences of positions


def check(examined: Examined) -> Check:
    """Count repeats among rows in which the arm moves so fast that rounding explains none."""
    recorded = examined.recorded
    same, moving = repeats(recorded), fast(recorded)
    total = int(moving.sum())
    if total < FEWEST:
        return Check(NAME, "Nothing moves fast enough for a repeated reading to say anything.")
    share = float(same[moving].mean())
    text = f"{percent(share)} of the {total} rows in fast motion repeat the reading before"
    if share <= TOLERATED:
        return Check(NAME, text + ".")
    return Check(
        NAME, f"{text}, which rounding cannot explain: {pattern(same & moving, 1 / recorded.evidence.period)}", False
    )


def repeats(recorded: Recorded) -> np.ndarray:
    """Return which rows repeat the reading before in every joint, shape (E, T − 1).

    A velocity register that changes proves a fresh reading; velocities that were derived from the positions do not.
    """
    same = np.asarray((np.diff(recorded.positions, axis=1) == 0).all(axis=2))
    if not derived(recorded):
        same &= (np.diff(recorded.velocities, axis=1) == 0).all(axis=2)
    return same


def derived(recorded: Recorded) -> bool:
    """Whether the velocities are differences of the positions, backward or smoothed over five."""
    position, rate = recorded.positions, 1 / recorded.evidence.period
    inner = recorded.evidence.counts.copy()
    inner[:, :4] = False
    inner[:, :-4] &= recorded.evidence.counts[:, 4:]
    inner[:, -4:] = False
    backward = np.diff(position, axis=1, prepend=position[:, :1]) * rate
    shifted = [np.roll(position, -shift, axis=1) for shift in (-2, -1, 1, 2)]
    smoothed = (-2 * shifted[0] - shifted[1] + shifted[2] + 2 * shifted[3]) / 10 * rate
    apart = [np.abs(recorded.velocities - other)[inner] for other in (backward, smoothed)]
    return any(bool(np.quantile(gap, 0.9) < DERIVED) for gap in apart if gap.size)


def fast(recorded: Recorded) -> np.ndarray:
    """Return in which rows some joint moves fast before and after in one direction, shape (E, T − 1).

    On either side the average over some rows counts, so that a repeat does not hide itself.
    """
    reach, position = recorded.reach, recorded.positions
    padded = np.pad(position, ((0, 0), (reach, reach), (0, 0)), mode="edge")
    before = (position - padded[:, : -2 * reach])[:, :-1] / reach
    after = (padded[:, 2 * reach :] - position)[:, 1:] / reach
    slower = np.where(before * after > 0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    counts = recorded.evidence.counts
    least = [FAST * quantum(position[..., joint][counts]) for joint in range(position.shape[2])]
    largest = np.quantile(np.abs(np.diff(position, axis=1))[counts[:, 1:]], 0.99, axis=0)
    least = np.maximum(np.maximum(least, FASTER * largest), SMALLEST)
    return np.asarray((slower > least).any(axis=2) & counts[:, 1:])


def pattern(same: np.ndarray, rate: float) -> str:
    """Say whether repeats come at a beat, which tells the device's own rate [Hz], or here and there."""
    gaps = np.concatenate([np.diff(np.flatnonzero(row)) for row in same])
    beat = gaps[np.abs(gaps - np.median(gaps)) <= 1] if gaps.size else gaps
    if gaps.size and len(beat) >= REGULAR * len(gaps):
        device = rate * (1 - 1 / float(beat.mean()))
        return (
            f"they come at a beat, so the device gives about {device:.3g} readings a second, not {rate:.4g}; record "
            "at that rate, or a delay of up to one of its periods will be found."
        )
    return "they come here and there: answers were lost, or logged twice."
