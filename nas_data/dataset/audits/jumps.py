"""Jumps: position changes between rows that the joint cannot make."""

import numpy as np

from nas_data.dataset.audits.base import (
    REMOVE,
    UNWRAP,
    AuditFinding,
    Expected,
    find_radian_equivalents,
    list_row_numbers,
)
from nas_data.dataset.recording import Recording
from nas_data.joint_units import USUAL_RANGE, convert_hinge_unit

FASTEST = 50.0  # [rad/s] above any usual hinge; a slide needs more than 20 ms for its range
WHOLE_TURN = 2 * np.pi  # [rad]


def find_whole_turns(moves: np.ndarray) -> np.ndarray:
    """Return a mask of the steps of a hinge's position [rad] that are a whole turn to within 10 %, same shape."""
    return np.abs(np.abs(moves) - WHOLE_TURN) < 0.1 * WHOLE_TURN


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report rows that a joint could only reach at more than the map's `max_speed`."""
    # Rows with equal time, which the timing audit reports, are assumed one nominal period apart.
    steps = np.diff(recording.time)
    steps = np.where(steps > 0, steps, 1 / expected.rate)[:, None]
    moves = np.diff(recording.positions, axis=0)
    speeds = np.vstack([np.zeros((1, moves.shape[1])), np.abs(moves) / steps])
    if recording.velocities is not None:
        speeds = np.maximum(speeds, np.abs(recording.velocities))
    is_slide = [joint in expected.slides for joint in recording.joints]
    limits = FASTEST * np.where(is_slide, USUAL_RANGE * find_radian_equivalents(recording, expected), 1.0)
    if expected.max_speed is not None:
        limits[:] = expected.max_speed
    fast = speeds > limits
    found = []
    for index, joint in enumerate(recording.joints):
        rows = list_row_numbers(recording.rows, fast[:, index])
        if rows:
            wraps = joint not in expected.slides and find_whole_turns(moves[:, index]).any()
            unit = convert_hinge_unit("rad/s", joint in expected.slides)
            remedy = (
                f"jumps of a whole turn come from an encoder that wraps around: {UNWRAP}"
                if wraps
                else f"if the joint is that fast, set a larger max_speed in [audit]; if readings are wrong, {REMOVE}"
            )
            what = (
                f"{joint} reaches {speeds[:, index].max():.4g} {unit} in {recording.name_rows(rows)}, "
                f"more than {limits[index]:.4g} {unit}"
            )
            found.append(AuditFinding("jump", recording.label, what, remedy, rows))
    return found
