"""Repeated samples: readings that are bit-identical to the previous one while the joint or its command moves."""

import numpy as np

from nas_data.dataset.audits.base import REMOVE, AuditFinding, Expected, find_radian_equivalents, list_row_numbers
from nas_data.dataset.audits.torque_off import SIGNAL as TORQUE
from nas_data.dataset.features import POSITION
from nas_data.dataset.noise import SMALLEST, find_quantisation_step
from nas_data.dataset.recording import Recording
from nas_data.dataset.rows import find_row_spans

MIN_QUANTA = 2.5  # [quanta] a joint that moves this far per row cannot repeat a reading …
MIN_MOVE_SHARE = 0.2  # … nor one that moves this share of its largest moves, if resampling has blurred the quanta
AVERAGING_TIME = 0.05  # [s] on either side over which a speed is averaged if there is no velocity register
COMMANDED = 0.02  # [rad], [rad/s] or [N·m] smallest range of a command during repeats that are reported
MIN_REPEAT_SECONDS = 0.1  # [s] shorter repeats are normal for a quantised reading at rest
STUCK_SECONDS = 1.5  # [s] a joint that stands still for this long …
MIN_COMMAND_TRAVEL = 0.2  # … [rad] while its own command moves this far does not follow it
TOLERATED_SHARE = 0.02  # tolerated share of repeats among rows in motion: an occasional lost reply
REGULAR = 0.7  # share of equal gaps between repeats that shows the device's own rate
MIN_BEAT_REPEATS = 5  # fewest repeats for such a rate


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report repeated readings: those that are certainly stale, and those that stiction could explain as well."""
    same = _find_repeated_rows(recording)
    moving = _find_moving_rows(recording, expected)
    stale = same & moving
    rows = list_row_numbers(recording.rows, stale)
    found = []
    if rows:
        what = (
            f"readings repeat the previous one in {recording.name_rows(rows)} although the joint moves: "
            f"{_describe_pattern(stale, expected.rate)}"
        )
        minor = len(rows) <= TOLERATED_SHARE * np.count_nonzero(moving)
        remedy = "to avoid this, record at the rate of the robot's readings or more slowly"
        found.append(AuditFinding("repeated_samples", recording.label, what, remedy, rows, minor=minor))
    held = _find_held_rows(recording, expected, same & ~stale)
    rows = list_row_numbers(recording.rows, held)
    if rows:
        longest = max(last - first + 1 for first, last in find_row_spans(np.flatnonzero(held)))
        what = (
            f"the reading is constant for up to {longest / expected.rate:.2g} s while the command changes, in "
            f"{recording.name_rows(rows)}: the joint sticks, or the readings are stale; the log does not show which"
        )
        found.append(AuditFinding("repeated_samples", recording.label, what, rows=rows, minor=True))
    return found + _report_stuck_joints(recording, expected, held)


def _find_repeated_rows(recording: Recording) -> np.ndarray:
    """Return a mask of the rows that repeat position and velocity of all joints, shape (N,).

    A velocity register that changes proves a fresh reading. Rows with the time of the row before may be one reading
    that was written twice; the timing audit reports them.
    """
    readings = recording.positions
    if recording.velocities is not None:
        readings = np.hstack([readings, recording.velocities])
    same = (readings[1:] == readings[:-1]).all(axis=1) & (np.diff(recording.time) > 0)
    return np.concatenate([[False], same])


def _find_moving_rows(recording: Recording, expected: Expected) -> np.ndarray:
    """Return a mask of the rows in a motion that must change the next reading, shape (N,).

    The motion per row is that of the velocity register. Without one, it is the smaller of the mean moves before and
    after the row, if both have one direction; the average prevents a repeat from hiding itself.
    """
    positions = recording.positions
    if recording.velocities is not None:
        moves = np.abs(recording.velocities) / expected.rate
    else:
        reach = max(1, round(AVERAGING_TIME * expected.rate))
        padded = np.pad(positions, ((reach + 1, reach), (0, 0)), mode="edge")
        before = (padded[reach:-reach] - padded[: -2 * reach])[:-1] / reach
        after = (padded[2 * reach :] - padded[reach:-reach])[1:] / reach
        moves = np.where(before * after > 0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    radians = find_radian_equivalents(recording, expected)
    coarse = MIN_QUANTA * radians * [find_quantisation_step(column) for column in (positions / radians).T]
    large = np.quantile(np.abs(np.diff(positions, axis=0)), 0.99, axis=0)
    return np.asarray((moves > np.maximum(np.maximum(coarse, MIN_MOVE_SHARE * large), SMALLEST * radians)).any(axis=1))


def _describe_pattern(stale: np.ndarray, rate: float) -> str:
    """Describe whether repeats are periodic, which shows the device's own rate [Hz], or irregular."""
    gaps = np.diff(np.flatnonzero(stale))
    beat = gaps[np.abs(gaps - np.median(gaps)) <= 1] if gaps.size else gaps
    if gaps.size >= MIN_BEAT_REPEATS and len(beat) >= REGULAR * len(gaps) and beat.mean() > 1:
        device = rate * (1 - 1 / float(beat.mean()))
        return (
            f"they are periodic, so the robot gave about {device:.3g} readings per second, not {rate:.4g}; nas gap "
            "will find a delay of up to one period of these readings"
        )
    return "they are irregular: the recorder read faster than the robot updated its readings, or answers were lost"


def _find_held_rows(recording: Recording, expected: Expected, same: np.ndarray) -> np.ndarray:
    """Return a mask of the repeated rows in long runs during which the command keeps moving, shape (N,)."""
    held = np.zeros(len(recording), bool)
    positional = expected.find_commanded(recording.joints, POSITION)
    least = COMMANDED * np.where(positional, find_radian_equivalents(recording, expected), 1.0)
    commanded = np.concatenate([[False], (np.diff(recording.commands, axis=0) != 0).any(axis=1)])
    for first, last in find_row_spans(np.flatnonzero(same & commanded)):
        commands = recording.commands[first - 1 : last + 1]
        if (last - first + 1) / expected.rate >= MIN_REPEAT_SECONDS and (np.ptp(commands, axis=0) > least).any():
            held[first : last + 1] = True
    return held


def _report_stuck_joints(recording: Recording, expected: Expected, reported: np.ndarray) -> list[AuditFinding]:
    """Report position servos whose reading alone is constant for long while their command moves far."""
    found, radians = [], find_radian_equivalents(recording, expected)
    released = (recording.signals.get(TORQUE, np.ones((len(recording), 1))) == 0).any(axis=1)
    for index in np.flatnonzero(expected.find_commanded(recording.joints, POSITION)):
        joint = recording.joints[index]
        position, command = recording.positions[:, index], recording.commands[:, index]
        stuck = np.zeros(len(recording), bool)
        for first, last in find_row_spans(np.flatnonzero(np.diff(position) == 0) + 1):
            known = (reported | released)[first : last + 1].any()
            away = np.ptp(command[first - 1 : last]) > MIN_COMMAND_TRAVEL * radians[index]
            if (last - first + 1) / expected.rate >= STUCK_SECONDS and away and not known:
                stuck[first : last + 1] = True
        rows = list_row_numbers(recording.rows, stuck)
        if rows:
            what = (
                f"the reading of {joint} is constant in {recording.name_rows(rows)} while its command changes: the "
                "servo is blocked or its torque is off, or the readings are stale"
            )
            remedy = f"if its torque is off, name the column that shows this in [signals.{TORQUE}]; else {REMOVE}"
            found.append(AuditFinding("frozen_reading", recording.label, what, remedy, rows))
    return found
