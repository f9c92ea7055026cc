"""The velocity register against differenced positions: unit, sign and delay."""

from dataclasses import dataclass, replace

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, find_radian_equivalents
from nas_data.dataset.features import POSITION
from nas_data.dataset.recording import Recording
from nas_data.joint_units import convert_hinge_unit

UNLIKE_DISTANCE = 0.44  # relative distance of two speeds above which the motions differ: a correlation of 0.9
COMPARED_SHARE = 0.95  # share of the rows that are compared
MIN_IMPROVEMENT = 0.02  # smallest reduction of the distance that shows a delay
AVERAGING_TIME = 0.05  # [s] on either side over which velocities are averaged: a single quantum is no motion
HALVES_TOLERANCE = 0.25  # relative difference up to which both halves of a span count as equal
SLOWEST = 0.1  # share of the greatest speed below which a row is ignored
MIN_MOVING_ROWS = 50  # fewest rows in motion for a factor
MAX_DELAY_PERIODS = 6.0  # [periods] largest delay that is tried …
MAX_DELAY_TIME = 0.06  # [s] … and in seconds
DELAY_STEP_PERIODS = 0.25  # [periods] step of the tried delays …
MIN_DELAY_STEP = 1e-3  # [s] … and its least
LATE_PERIODS = 0.6  # [periods] smallest delay that is reported …
LATE_TIME = 3e-3  # [s] … and in seconds
MIN_CORRELATION = 0.9  # correlation above which register and difference are the same motion
FACTOR_NOTED = 1.15  # a register's filter reduces the amplitude by a few percent
SPEED_WINDOW = 0.2  # [s]
CERTAIN_SPEED = 0.3  # [rad/s] mean speed in that window that any register resolves; the STS3215's step is 0.08 rad/s
FACTOR_TOLERANCE = 0.1  # relative distance within which a factor equals a known one …
EXACT_FACTOR_TOLERANCE = 0.02  # … and within which it does if the sampling could explain it as well
FAST = 0.25  # share of the distance to its command per row above which a sampled velocity is clearly below the mean
OVERSHOT = 1.05  # share of that distance above which a joint overshoots

KNOWN = {  # at hinges
    57.2958: "degrees and radians",
    9.5493: "turns a minute and rad/s",
    6.0: "turns a minute and degrees a second",
    6.28319: "turns and radians",
    1000.0: "seconds and milliseconds",
}
KNOWN_OF_SLIDES = {1000.0: "millimetres and metres, or seconds and milliseconds", 100.0: "centimetres and metres"}


@dataclass(frozen=True)
class VelocityFit:
    """Relation of one joint's register to its differenced position.

    Attributes:
        factor: Register over difference.
        delay: Delay of the register [periods].
        travel_share: Share of the distance to its command that the joint moves in one row.
    """

    factor: float
    delay: float
    travel_share: float = 0.0

    def may_be_sampling(self) -> bool:
        """Whether the sampling alone may explain the difference of register and positions.

        A joint that reaches its command within a row is fast after each new command and slow when it is sampled. Its
        sampled velocity is then below its mean velocity in every row, and arbitrary if it overshoots.
        """
        return self.travel_share > OVERSHOT or (self.travel_share > FAST and 0 < self.factor < 1)


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse velocities of another unit or sign than the positions; report other factors and a late register."""
    if recording.velocities is None:
        return []
    fits = {
        joint: fit
        for index, joint in enumerate(recording.joints)
        if (fit := fit_register(recording, index, 1 / expected.rate)) is not None
    }
    positional = dict(zip(recording.joints, expected.find_commanded(recording.joints, POSITION), strict=True))
    # How soon a joint responds to a torque or speed command is unknown.
    fits = {joint: fit if positional[joint] else replace(fit, travel_share=1.0) for joint, fit in fits.items()}
    found = _report_silent_registers(recording, expected) + _report_wrong_scales(recording, expected, fits)
    if expected.derived:  # the register is then only an extra signal
        found = [replace(finding, error=False) for finding in found]
    least = LATE_TIME * expected.rate
    late = {
        joint: fit.delay
        for joint, fit in fits.items()
        if fit.delay >= max(LATE_PERIODS + (fit.travel_share > FAST), least)
    }
    if late and not expected.derived:
        delay = float(np.median(list(late.values())))
        what = (
            f"the velocity register of {', '.join(late)} is about {delay / expected.rate * 1e3:.2g} ms behind "
            "the position"
        )
        remedy = "velocity = 'derive' in the map takes it from the positions instead"
        found.append(AuditFinding("velocity_lag", recording.label, what, remedy))
    return found


def fit_register(recording: Recording, index: int, period: float) -> VelocityFit | None:
    """Fit the register's mean over a window to the mean velocity from positions over an earlier window.

    Both windows have one length, so that neither noise nor the length matters. Only steady motion counts, with equal
    distances in the first and second half of a window. If a fast servo completes a step within two rows, samples of its
    velocity do not show the motion between them.

    Returns:
        None if too little of the motion is steady.
    """
    assert recording.velocities is not None
    once = np.concatenate([[True], np.diff(recording.time) > 0])
    time, position = recording.time[once], recording.positions[once, index]
    register = recording.velocities[once, index]
    reach = max(1, round(AVERAGING_TIME / period))
    if len(time) < max(MIN_MOVING_ROWS, 4 * reach) or not np.any(register):
        return None
    spans = time[2 * reach :] - time[: -2 * reach]
    first, second = position[reach:-reach] - position[: -2 * reach], position[2 * reach :] - position[reach:-reach]
    speed, middles = (first + second) / spans, time[reach:-reach]
    steady = np.abs(first - second) <= HALVES_TOLERANCE * np.maximum(np.abs(first), np.abs(second))
    steady &= np.abs(speed) > SLOWEST * np.abs(speed).max()
    travel = np.concatenate([[0.0], np.cumsum((register[1:] + register[:-1]) / 2 * np.diff(time))])
    measured = (travel[2 * reach :] - travel[: -2 * reach]) / spans

    def compare(delay: float) -> tuple[float, float, float]:
        """Return the relative distance of register and delayed motion, the delay [s] and the factor."""
        rows = np.flatnonzero(np.interp(middles - delay, middles, steady, left=0, right=0) == 1)
        if len(rows) < MIN_MOVING_ROWS // 2:
            return float(np.inf), delay, 1.0
        factor, apart = _fit(np.interp(middles[rows] - delay, middles, speed), measured[rows])
        return apart, delay, factor

    best = undelayed = compare(0.0)
    if undelayed[0] > MIN_IMPROVEMENT:  # otherwise no delay improves the fit clearly
        step = max(DELAY_STEP_PERIODS * period, MIN_DELAY_STEP)
        delayed = min(
            compare(float(number * step))
            for number in range(-1, int(max(MAX_DELAY_PERIODS * period, MAX_DELAY_TIME) / step) + 2)
        )
        # The motion may be too steady to show its delay.
        best = delayed if delayed[0] < undelayed[0] - MIN_IMPROVEMENT else undelayed
    apart, delay, factor = best
    if apart > UNLIKE_DISTANCE:
        return None
    travel_share = _estimate_travel_share(recording, index)
    if undelayed[0] > MIN_IMPROVEMENT and travel_share <= FAST:  # otherwise both delays are equivalent
        delay = _find_delay(time, position, register, period) or delay
    return VelocityFit(factor, delay / period, travel_share)


def _find_delay(time: np.ndarray, position: np.ndarray, register: np.ndarray, period: float) -> float | None:
    """Return the delay [s] at which register and differenced position agree best over all rows; None if nowhere."""
    difference, middles = np.diff(position) / np.diff(time), (time[1:] + time[:-1]) / 2
    best: tuple[float, float | None] = (MIN_CORRELATION, None)
    for delay in np.arange(-1.0, MAX_DELAY_PERIODS + DELAY_STEP_PERIODS, DELAY_STEP_PERIODS) * period:
        delayed = np.interp(time - delay, middles, difference)
        size = float(np.linalg.norm(delayed) * np.linalg.norm(register))
        likeness = abs(float(delayed @ register)) / size if size else 0.0
        best = (likeness, float(delay)) if likeness > best[0] else best
    return best[1]


def _fit(earlier: np.ndarray, later: np.ndarray) -> tuple[float, float]:
    """Return the factor between speeds, and their remaining relative distance; the worst rows are excluded.

    Another audit reports single wrong samples.
    """
    rest = np.abs(later - float(np.median(later / earlier)) * earlier)
    kept = rest <= np.quantile(rest, COMPARED_SHARE)
    earlier, later = earlier[kept], later[kept]
    size = float(np.sqrt(np.mean(later**2)))
    if size == 0:
        return 0.0, 1.0
    factor = float(earlier @ later) / float(earlier @ earlier)
    return factor, float(np.sqrt(np.mean((later - factor * earlier) ** 2))) / size


def _report_silent_registers(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Refuse registers that are always zero although their joint moves."""
    assert recording.velocities is not None
    rows = max(round(SPEED_WINDOW * expected.rate), 1)
    if len(recording) <= rows:
        return []
    speeds = np.abs(recording.positions[rows:] - recording.positions[:-rows]).max(axis=0) * expected.rate / rows
    silent = ~recording.velocities.any(axis=0) & (speeds > CERTAIN_SPEED * find_radian_equivalents(recording, expected))
    if not silent.any():
        return []
    names = [joint for joint, zero in zip(recording.joints, silent, strict=True) if zero]
    fastest = recording.joints[int(np.argmax(np.where(silent, speeds, 0)))]
    what = (
        f"the velocity of {', '.join(names)} is zero in all rows although the position moves at up to "
        f"{speeds[silent].max():.2g} {convert_hinge_unit('rad/s', fastest in expected.slides)}"
    )
    return [AuditFinding("velocity_scale", recording.label, what, "set velocity = 'derive' in the map", error=True)]


def _report_wrong_scales(recording: Recording, expected: Expected, fits: dict[str, VelocityFit]) -> list[AuditFinding]:
    """Report joints whose register has another sign or scale than the position."""
    found = []
    wrong = [joint for joint, fit in fits.items() if fit.factor < 0 and not fit.may_be_sampling()]
    if wrong:
        what = f"the velocity of {', '.join(wrong)} has the sign opposite to the differenced position"
        remedy = "correct 'sign' in [read.velocity] or [read.position]"
        found.append(AuditFinding("velocity_scale", recording.label, what, remedy, error=True))
    for joint, fit in fits.items():
        size = abs(fit.factor)
        if 1 / FACTOR_NOTED < size < FACTOR_NOTED:
            continue
        near = EXACT_FACTOR_TOLERANCE if fit.may_be_sampling() else FACTOR_TOLERANCE
        factors = (KNOWN_OF_SLIDES if joint in expected.slides else KNOWN).items()
        known = next((name for factor, name in factors if _is(size, factor, near) or _is(size, 1 / factor, near)), None)
        if fit.may_be_sampling() and known is None:
            continue
        reason = f", the factor between {known}" if known else ""
        what = f"the velocity of {joint} is {size:.3g} times the differenced position{reason}"
        remedy = "correct the unit or 'scale' in [read.velocity], [read.position] or [read.time]"
        found.append(AuditFinding("velocity_scale", recording.label, what, remedy, error=known is not None))
    return found


def _is(value: float, wanted: float, near: float) -> bool:
    return abs(value / wanted - 1) < near


def _estimate_travel_share(recording: Recording, index: int) -> float:
    """Return the typical share of the distance to its command that a joint moves per row; above 1 for overshoot."""
    position, command = recording.positions[:, index], recording.commands[:, index]
    moves = np.diff(position)
    rows = np.abs(moves) > SLOWEST * np.abs(moves).max(initial=0.0)
    # A row's command acts before or after its state; the nearer one implies the faster servo.
    shares = [
        np.median((moves / np.where(ways == 0, np.inf, ways))[rows])
        for ways in (command[:-1] - position[:-1], command[1:] - position[:-1])
        if rows.any()
    ]
    return float(np.max(shares, initial=0.0))
