"""Motion: the change of a position in a time window against the integral of its velocity register."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, find_radian_equivalents, list_row_numbers
from nas_data.dataset.audits.velocity import DELAY_STEP_PERIODS, MAX_DELAY_PERIODS, VelocityFit, fit_register
from nas_data.dataset.recording import Recording
from nas_data.dataset.rows import find_row_spans

WINDOW_SECONDS = 0.2  # [s] a register's filter and a coarse encoder average out over it
ROWS = 5  # fewest rows for a mean speed
MIN_SPEED_DIFFERENCE = 0.3  # [rad/s] smallest difference of mean speeds, above the resolution of a register …
MIN_DIFFERENCE_SHARE = 0.5  # … and smallest share of the larger speed, above what a filter removes
FROZEN = 0.5  # [s] a position that is constant for this long …
MIN_REGISTER_TRAVEL = 0.1  # [rad] … while the register's integral changes this much was not measured
MIN_WINDOWS = 2  # [windows] one wrong sample affects one window, a contradiction lasts longer


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report rows in which a joint's position contradicts its velocity."""
    once = np.concatenate([[True], np.diff(recording.time) > 0])
    if recording.velocities is None or np.count_nonzero(once) <= MIN_WINDOWS * max(
        round(WINDOW_SECONDS * expected.rate), ROWS
    ):
        return []
    found, radians = [], find_radian_equivalents(recording, expected)
    for index, joint in enumerate(recording.joints):
        # The velocity audit reports a register that is always zero.
        if not recording.velocities[:, index].any():
            continue
        fit = fit_register(recording, index, 1 / expected.rate)
        delays = (
            [fit.delay] if fit else np.arange(-1.0, MAX_DELAY_PERIODS + DELAY_STEP_PERIODS, DELAY_STEP_PERIODS).tolist()
        )  # [periods]
        fits = [VelocityFit(fit.factor if fit else 1.0, delay) for delay in delays]
        radian = float(radians[index])
        wrong = min(
            (_find_contradicting_rows(recording, expected, index, one, radian) for one in fits), key=np.count_nonzero
        )
        wrong |= _find_frozen_rows(recording, expected, index, radian)
        if wrong.any():
            rows = list_row_numbers(recording.rows, wrong)
            what = (
                f"the position of {joint} contradicts its velocity in {recording.name_rows(rows)}: one of them is "
                "stale or another joint's"
            )
            remedy = "check 'columns' in [read.position] and [read.velocity]"
            found.append(AuditFinding("position_contradicts_velocity", recording.label, what, remedy, rows))
    return found


def _find_contradicting_rows(
    recording: Recording, expected: Expected, index: int, fit: VelocityFit, radian: float
) -> np.ndarray:
    """Return a mask of the rows in long runs of windows whose mean speeds disagree, shape (N,)."""
    assert recording.velocities is not None
    rows = max(round(WINDOW_SECONDS * expected.rate), ROWS)
    once = np.concatenate([[True], np.diff(recording.time) > 0])
    time, position = recording.time[once], recording.positions[once, index]
    register = np.interp(time + fit.delay / expected.rate, time, recording.velocities[once, index]) / fit.factor
    travel = np.concatenate([[0.0], np.cumsum((register[1:] + register[:-1]) / 2 * np.diff(time))])
    span = time[rows:] - time[:-rows]
    moved, integrated = (position[rows:] - position[:-rows]) / span, (travel[rows:] - travel[:-rows]) / span
    larger = np.maximum(np.abs(moved), np.abs(integrated))
    # Velocity samples miss the motion between them: up to half of the change of the moves from row to row.
    changes = np.cumsum(np.abs(np.diff(position, 2, prepend=[position[0]] * 2)))
    missed = (changes[rows:] - changes[:-rows]) / 2 / span
    apart = np.abs(moved - integrated) > np.maximum(
        np.maximum(MIN_SPEED_DIFFERENCE * radian, MIN_DIFFERENCE_SHARE * larger), missed
    )
    wrong = np.zeros(len(time), bool)
    for first, last in find_row_spans(np.flatnonzero(apart)):
        if last - first + 1 >= MIN_WINDOWS * rows:
            wrong[first + rows // 2 : last + 1 + rows // 2] = True
    every = np.zeros(len(recording), bool)
    every[once] = wrong
    return every


def _find_frozen_rows(recording: Recording, expected: Expected, index: int, radian: float) -> np.ndarray:
    """Return a mask of the rows with a long constant position while the register shows motion, shape (N,)."""
    assert recording.velocities is not None
    position, register = recording.positions[:, index], recording.velocities[:, index]
    frozen = np.zeros(len(recording), bool)
    for first, last in find_row_spans(np.flatnonzero(np.diff(position) == 0) + 1):
        late = register[first + int(MAX_DELAY_PERIODS) : last + 1]
        if (
            (last - first + 1) / expected.rate < FROZEN
            or not late.size
            or np.abs(late).max() < MIN_SPEED_DIFFERENCE * radian
        ):
            continue
        if np.ptp(np.cumsum(late)) / expected.rate > MIN_REGISTER_TRAVEL * radian:
            frozen[first : last + 1] = True
    return frozen
