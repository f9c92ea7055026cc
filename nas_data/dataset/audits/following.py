"""Following: each joint follows its own command and not another joint's."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, find_radian_equivalents
from nas_data.dataset.features import POSITION, VELOCITY
from nas_data.dataset.recording import Recording

MIN_ROWS = 20  # fewest rows for a meaningful correlation
MIN_DEVIATION = 0.05  # [rad] smallest standard deviation of a position that exceeds droop and play
MIN_CORRELATION = 0.9  # correlation above which a position follows a command
MAX_UNRELATED_CORRELATION = 0.5  # correlation below which it does not
MAX_DISTANCE_RATIO = 0.5  # largest distance of a position from another joint's command over that from its own


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report commands that are the measured positions, and joints that follow another joint's command."""
    if len(recording) < MIN_ROWS:
        return []
    return _report_copied_commands(recording, expected) + _report_swapped_commands(recording, expected)


def _report_copied_commands(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report joints whose command equals the measurement in all rows: a copied column, not a perfect servo."""
    found = []
    for kind, name in ((POSITION, "position"), (VELOCITY, "velocity")):
        measured = recording.positions if kind == POSITION else recording.velocities
        if measured is None:
            continue
        same = np.isclose(recording.commands, measured, rtol=0, atol=1e-9).all(axis=0)
        same &= (measured.std(axis=0) > 1e-6) & expected.find_commanded(recording.joints, kind)
        if same.any():
            names = ", ".join(joint for joint, copied in zip(recording.joints, same, strict=True) if copied)
            what = f"the command of {names} equals the measured {name} in all rows"
            remedy = "check that [read.command] names the commands, not what was measured"
            found.append(AuditFinding("command_is_position", recording.label, what, remedy))
    return found


def _report_swapped_commands(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report joints that follow another joint's position command and not their own."""
    found, radians = [], find_radian_equivalents(recording, expected)
    positional = expected.find_commanded(recording.joints, POSITION)
    for index in np.flatnonzero(positional):
        joint, position = recording.joints[index], recording.positions[:, index]
        distance = np.where(positional, np.std(position[:, None] - recording.commands, axis=0), np.inf)
        other = int(np.argmin(distance))
        if (
            other == index
            or position.std() < MIN_DEVIATION * radians[index]
            or distance[other] > MAX_DISTANCE_RATIO * distance[index]
        ):
            continue
        own = _compute_correlation(position, recording.commands[:, index])
        if (
            _compute_correlation(position, recording.commands[:, other]) >= MIN_CORRELATION
            and own <= MAX_UNRELATED_CORRELATION
        ):
            what = (
                f"the position of {joint} follows the command of {recording.joints[other]} in all rows, not its own "
                f"(correlation {own:.2f})"
            )
            remedy = "check the order of the columns in [read.position] and [read.command]"
            found.append(AuditFinding("joints_swapped", recording.label, what, remedy))
    return found


def _compute_correlation(position: np.ndarray, command: np.ndarray) -> float:
    """Return the correlation; zero for a constant command."""
    return float(np.corrcoef(position, command)[0, 1]) if command.std() > 1e-9 else 0.0
