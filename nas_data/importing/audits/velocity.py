"""The velocity register against the differenced position: its unit, its sign, its delay."""

from dataclasses import dataclass

import numpy as np

from nas_data.importing.finding import Finding
from nas_data.importing.map import Map
from nas_data.importing.recording import Recording

ALIKE = 0.9  # correlation from which register and difference are the same motion
ENOUGH = 50  # rows in motion from which a factor is worth naming
LATEST = 6.0  # [periods] latest register that is looked for
STEP = 0.25  # [periods]
LATE = 0.6  # [periods] delay that is reported
FACTOR_NOTED = 1.15  # a register filters what it measures, which costs it a few percent of the amplitude
WHILE = 0.2  # [s]
SURELY_MOVING = 0.3  # [rad/s] mean speed over that while which any register shows; the STS3215's step is 0.08 rad/s
NEAR = 0.1  # relative distance within which a factor is a known one

KNOWN = {
    57.2958: "degrees and radians",
    9.5493: "turns a minute and rad/s",
    6.0: "turns a minute and degrees a second",
    6.28319: "turns and radians",
    1000.0: "seconds and milliseconds",
}


@dataclass(frozen=True)
class Fit:
    """How one joint's register relates to its differenced position.

    Attributes:
        factor: Register per difference.
        delay: How late the register is [periods].
    """

    factor: float
    delay: float


def check(recording: Recording, mapping: Map) -> list[Finding]:
    """Refuse velocities of another unit or sign than the positions; report other factors, and a late register."""
    if recording.velocities is None:
        return []
    fits = {
        joint: fit
        for index, joint in enumerate(recording.joints)
        if (fit := fit_register(recording, index, 1 / mapping.rate)) is not None
    }
    found = _silent(recording, mapping) + _scales(recording, fits)
    late = [fit.delay for fit in fits.values() if fit.delay >= LATE]
    if late and not mapping.derive_velocity:
        message = (
            f"the velocity register of {_names([j for j, fit in fits.items() if fit.delay >= LATE])} is about "
            f"{np.median(late) / mapping.rate * 1e3:.2g} ms behind the position; velocity = 'derive' in the map takes "
            "it from the positions instead."
        )
        found.append(Finding("velocity_lag", recording.place, message))
    return found


def fit_register(recording: Recording, index: int, period: float) -> Fit | None:
    """Fit the register to the delayed difference; None where the motion is too small to tell."""
    assert recording.velocities is not None
    once = np.concatenate([[True], np.diff(recording.time) > 0])
    time, position = recording.time[once], recording.positions[once, index]
    register = recording.velocities[once, index]
    if len(time) < ENOUGH or not np.any(register):
        return None
    difference = np.diff(position) / np.diff(time)
    middles = (time[1:] + time[:-1]) / 2
    best: tuple[float, Fit] | None = None
    for delay in np.arange(-1.0, LATEST + STEP, STEP):
        delayed = np.interp(time - delay * period, middles, difference)
        power = float(delayed @ delayed)
        moving = np.count_nonzero(np.abs(delayed) > 0.1 * np.abs(delayed).max())
        if power == 0 or moving < ENOUGH // 2:
            continue
        product = float(delayed @ register)
        likeness = product / np.sqrt(power * float(register @ register))
        if best is None or abs(likeness) > abs(best[0]):
            best = likeness, Fit(product / power, float(delay))
    return best[1] if best is not None and abs(best[0]) >= ALIKE else None


def _silent(recording: Recording, mapping: Map) -> list[Finding]:
    """Refuse registers that are zero in all rows although their joint moves."""
    assert recording.velocities is not None
    rows = max(round(WHILE * mapping.rate), 1)
    if len(recording) <= rows:
        return []
    speeds = np.abs(recording.positions[rows:] - recording.positions[:-rows]).max(axis=0) * mapping.rate / rows
    silent = ~recording.velocities.any(axis=0) & (speeds > SURELY_MOVING)
    if not silent.any():
        return []
    names = _names([joint for joint, zero in zip(recording.joints, silent, strict=True) if zero])
    message = (
        f"the velocity of {names} is zero in all rows although the position moves at up to "
        f"{speeds[silent].max():.2g} rad/s; say velocity = 'derive' in the map."
    )
    return [Finding("velocity_scale", recording.place, message, error=True)]


def _scales(recording: Recording, fits: dict[str, Fit]) -> list[Finding]:
    """Report joints whose register has another sign or scale than the position."""
    found = []
    wrong = [joint for joint, fit in fits.items() if fit.factor < 0]
    if wrong:
        message = (
            f"the velocity of {_names(wrong)} has the sign opposite to the differenced position; "
            "correct 'sign' in [read.velocity] or [read.position]."
        )
        found.append(Finding("velocity_scale", recording.place, message, error=True))
    for joint, fit in fits.items():
        size = abs(fit.factor)
        if 1 / FACTOR_NOTED < size < FACTOR_NOTED:
            continue
        known = next((name for factor, name in KNOWN.items() if _near(size, factor) or _near(size, 1 / factor)), None)
        reason = f", the factor between {known}" if known else ""
        message = (
            f"the velocity of {joint} is {size:.4g} times the differenced position{reason}; "
            "correct the unit or 'scale' in [read.velocity], [read.position] or [read.time]."
        )
        found.append(Finding("velocity_scale", recording.place, message, error=known is not None))
    return found


def _near(value: float, wanted: float) -> bool:
    return abs(value / wanted - 1) < NEAR


def _names(joints: list[str]) -> str:
    return ", ".join(joints)
