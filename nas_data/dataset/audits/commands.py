"""Commands against positions: a joint that follows its command must do so in the same unit and sign."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected
from nas_data.dataset.features import POSITION
from nas_data.dataset.recording import Recording

ENOUGH = 20  # rows from which a correlation says something
FOLLOWED = 1.0  # [s] in which a servo has followed its commands, however slow it is
ALIKE = 0.7  # correlation from which the position follows the command
DEGREES = 180 / np.pi
WITHIN = 2.0  # a servo that lags or sags follows with another amplitude, but not by this factor


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse commands whose amplitude is off by the factor between two units; report opposite signs.

    That factor is about 57 between degrees and radians, 1,000 between millimetres and metres.
    """
    if len(recording) < ENOUGH:
        return []
    found = []
    for index in np.flatnonzero(expected.find_commanded(recording.joints, POSITION)):
        joint = recording.joints[index]
        command, position = recording.commands[:, index], recording.positions[:, index]
        spread = float(np.std(command)), float(np.std(position))
        if min(spread) < 1e-9:
            continue
        likeness = float(np.corrcoef(command, position)[0, 1])
        factor = spread[0] / spread[1]
        slide = joint in expected.slides
        ratio, units = (1e3, "millimetres and metres") if slide else (DEGREES, "degrees and radians")
        slip = any(1 / WITHIN < factor / wanted < WITHIN for wanted in (ratio, 1 / ratio))
        lasting = float(np.ptp(recording.time)) >= FOLLOWED
        if slip and lasting and abs(likeness) >= ALIKE:
            what = (
                f"the command of {joint} moves {factor:.3g} times as far as the position that follows it, about the "
                f"factor between {units}"
            )
            remedy = "correct the unit in [read.command] or [read.position]"
            found.append(AuditFinding("command_scale", recording.label, what, remedy, error=True))
        elif likeness <= -ALIKE:
            what = f"the position of {joint} moves against its command (correlation {likeness:.2f})"
            remedy = "check 'sign' in [read.command] and [read.position]"
            found.append(AuditFinding("command_sign", recording.label, what, remedy))
    return found
