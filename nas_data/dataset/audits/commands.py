"""Commands against motion: a joint that follows its command must do so in the same unit and sign."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected
from nas_data.dataset.audits.torque_off import SIGNAL as TORQUE
from nas_data.dataset.audits.velocity import FACTOR_TOLERANCE, KNOWN, KNOWN_OF_SLIDES
from nas_data.dataset.features import POSITION, VELOCITY
from nas_data.dataset.recording import Recording
from nas_data.dataset.torque_off import find_longest_run

MIN_ROWS = 20  # fewest rows for a meaningful correlation
FOLLOWING_TIME = 1.0  # [s] within which even a slow servo follows its command
MIN_CORRELATION = 0.7  # correlation above which the position follows the command
DEGREES = 180 / np.pi
AVERAGING_TIME = 0.25  # [s] over which commanded velocity and motion are averaged, because servos lag
MAX_AMPLITUDE_RATIO = 2.0  # largest ratio of amplitudes that lag or droop can cause


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse commands whose amplitude is off by the factor between two units; report opposite signs.

    That factor is about 57 between degrees and radians, 1,000 between millimetres and metres. Commanded positions are
    compared with positions, commanded velocities with differences of positions, both where the torque is on.
    """
    if TORQUE in recording.signals:
        powered = np.asarray((recording.signals[TORQUE] >= 1).all(axis=1))
        recording = recording.take(find_longest_run(powered))
    if len(recording) < MIN_ROWS:
        return []
    found = []
    speeds = expected.find_commanded(recording.joints, VELOCITY)
    for index in np.flatnonzero(speeds | expected.find_commanded(recording.joints, POSITION)):
        joint, speed = recording.joints[index], bool(speeds[index])
        commands, motion = (_average_speeds if speed else _centre_positions)(recording, index)
        size = float(np.linalg.norm(commands)), float(np.linalg.norm(motion))
        if min(size) < 1e-9 * np.sqrt(len(recording)):
            continue
        likeness = float(commands @ motion) / (size[0] * size[1])
        factor = size[0] / size[1]
        slide = joint in expected.slides
        ratio, units = (1e3, "millimetres and metres") if slide else (DEGREES, "degrees and radians")
        slip = _is_factor(factor, ratio, MAX_AMPLITUDE_RATIO)
        if speed and not slip:  # such a factor may also be due to a weak servo
            known = KNOWN_OF_SLIDES if slide else KNOWN
            units = next((words for one, words in known.items() if _is_factor(factor, one, 1 + FACTOR_TOLERANCE)), "")
        lasting = float(np.ptp(recording.time)) >= FOLLOWING_TIME
        if (slip or (speed and units)) and lasting and abs(likeness) >= MIN_CORRELATION:
            times = f"is {factor:.3g} times as fast as" if speed else f"moves {factor:.3g} times as far as"
            what = f"the command of {joint} {times} the position that follows it, about the factor between {units}"
            remedy = "correct the unit in [read.command] or [read.position]"
            found.append(AuditFinding("command_scale", recording.label, what, remedy, error=slip))
        elif likeness <= -MIN_CORRELATION:
            what = f"the position of {joint} moves against its command (correlation {likeness:.2f})"
            remedy = "check 'sign' in [read.command] and [read.position]"
            found.append(AuditFinding("command_sign", recording.label, what, remedy))
    return found


def _is_factor(factor: float, wanted: float, within: float) -> bool:
    """Whether a factor is close to the wanted one, or its inverse."""
    return any(1 / within < factor / one < within for one in (wanted, 1 / wanted))


def _centre_positions(recording: Recording, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's commanded and measured positions minus their means, shape (N,) each."""
    command, position = recording.commands[:, index], recording.positions[:, index]
    return command - command.mean(), position - position.mean()


def _average_speeds(recording: Recording, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's commanded and actual mean speeds in overlapping windows [rad/s; m/s], shape (M,) each.

    Actual speeds are from positions, because a velocity register may be late, coarse or absent.
    """
    time, command, position = recording.time, recording.commands[:, index], recording.positions[:, index]
    rows = max(1, int(np.searchsorted(time, time[0] + AVERAGING_TIME)))
    asked = np.concatenate([[0.0], np.cumsum(command[:-1] * np.diff(time))])
    spans = np.maximum(time[rows:] - time[:-rows], 1e-9)
    return (asked[rows:] - asked[:-rows]) / spans, (position[rows:] - position[:-rows]) / spans
