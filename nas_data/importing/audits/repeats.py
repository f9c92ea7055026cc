"""Repeated samples: a reading that is bit for bit the one before while the joint or its command moves."""

import numpy as np

from nas_data.importing.finding import Finding, row_numbers
from nas_data.importing.map import Map
from nas_data.importing.recording import Recording
from nas_data.importing.rows import rows_text, spans

MOVED = 2.5  # [quanta] a joint that moves this far a row cannot give the same reading twice
COMMANDED = 0.02  # [rad] or [N·m]; a command that moves this far while all readings repeat is worth a word
LASTING = 0.1  # [s] such repeats that are shorter are ordinary rests of a quantised reading


def check(recording: Recording, mapping: Map) -> list[Finding]:
    """Report repeated readings: surely stale ones, and those that stiction could explain as well."""
    same = _same_as_before(recording)
    stale = same & _moving(recording, mapping)
    rows = row_numbers(recording.rows, stale)
    found = []
    if rows:
        message = (
            f"the reading before is repeated in {rows_text(rows)} although the joint moves: "
            "the recorder was faster than the robot answered, or lost an answer."
        )
        found.append(Finding("repeated_samples", recording.place, message, rows))
    held = _held(recording, mapping, same & ~stale)
    rows = row_numbers(recording.rows, held)
    if rows:
        longest = max(last - first + 1 for first, last in spans(np.flatnonzero(held)))
        message = (
            f"the reading stays the same for up to {longest / mapping.rate:.2g} s while the command moves, in "
            f"{rows_text(rows)}: a joint that sticks, or stale readings; the log alone cannot tell."
        )
        found.append(Finding("repeated_samples", recording.place, message, rows))
    return found


def _same_as_before(recording: Recording) -> np.ndarray:
    """Return which rows repeat position and velocity of all joints, shape (N,)."""
    readings = recording.positions
    if recording.velocities is not None:
        readings = np.hstack([readings, recording.velocities])
    same = (readings[1:] == readings[:-1]).all(axis=1)
    return np.concatenate([[False], same])


def _moving(recording: Recording, mapping: Map) -> np.ndarray:
    """Return which rows lie in a motion that must change the next reading, shape (N,).

    The motion a row is the velocity register's, or, where there is none, the smaller of the last real move before
    the row and the next one after it.
    """
    moves = np.abs(np.diff(recording.positions, axis=0, prepend=recording.positions[:1]))
    positive = np.where(moves > 1e-9, moves, np.inf)
    quantum = positive.min(axis=0)
    if recording.velocities is not None:
        expected = np.abs(recording.velocities) / mapping.rate
    else:
        expected = np.minimum(_neighbour(moves, 1), _neighbour(moves, -1))
    return (expected > MOVED * quantum).any(axis=1)


def _neighbour(moves: np.ndarray, shift: int) -> np.ndarray:
    """Return the moves of the row before (shift 1) or after (-1), zero beyond the ends; shape (N, n)."""
    shifted = np.zeros_like(moves)
    if shift > 0:
        shifted[1:] = moves[:-1]
    else:
        shifted[:-1] = moves[1:]
    return shifted


def _held(recording: Recording, mapping: Map, same: np.ndarray) -> np.ndarray:
    """Return which repeated rows belong to a lasting run in which the command moves all the time, shape (N,)."""
    held = np.zeros(len(recording), bool)
    commanded = np.concatenate([[False], (np.diff(recording.commands, axis=0) != 0).any(axis=1)])
    for first, last in spans(np.flatnonzero(same & commanded)):
        commands = recording.commands[first - 1 : last + 1]
        if (last - first + 1) / mapping.rate >= LASTING and np.ptp(commands, axis=0).max() > COMMANDED:
            held[first : last + 1] = True
    return held
