"""Time: it must increase, at the expected rate, in even steps."""

import numpy as np

from nas_data.dataset.audits.base import AuditFinding, Expected, list_row_numbers
from nas_data.dataset.recording import Recording

RATE_NOTED = 0.005  # relative deviation of the rate that is reported …
RATE_REFUSED = 0.05  # … and that is refused if rows are not resampled
RATE_FACTOR_REFUSED = 3.0  # … and if they are resampled: seconds in place of milliseconds, not a slower loop
GAP = 2.0  # [periods] step that resampling cannot fill
MISSING = 10.0  # [periods] fewer missing rows may be jitter or a busy computer …
SECONDS = 0.2  # … [s] and shorter gaps lose too little motion, even at high rates
TOLERATED_SHARE = 0.01  # share of uneven steps that affects no fit
MOST_REPEATED = 0.5  # share of repeated times above which the clock does not show when a row was measured
STEP_ROUNDING = 1e-3  # rounding of time stamps with few digits, as a share of a period


def check(recording: Recording, expected: Expected) -> list[AuditFinding]:
    """Report rows whose time decreases, repeats or jumps, and a rate other than expected."""
    if not np.isfinite(recording.time).all() or len(recording) < 2:
        return []
    steps = np.diff(recording.time)
    back = list_row_numbers(recording.rows[1:], steps < 0)
    if back:
        what = f"the time decreases in {recording.name_rows(back)}"
        remedy = (
            "if a new take begins there, name the column that numbers them in [read.episode], or give each take a file "
            "of its own; if rows are out of order within a take, sort them"
        )
        return [AuditFinding("time_backwards", recording.label, what, remedy, back, error=True)]
    found = []
    repeated = list_row_numbers(recording.rows[1:], steps == 0)
    if len(repeated) == len(steps):
        what = "the time is the same in all rows"
        remedy = "name the time column in [read.time], or set uniform = true there if the log has none"
        return [AuditFinding("repeated_time", recording.label, what, remedy, repeated, error=True)]
    if len(repeated) > MOST_REPEATED * len(steps) and not expected.resampled:
        what = f"most rows repeat the time of the row before: {recording.name_rows(repeated)}"
        remedy = (
            "if the rows are evenly spaced and the clock is too coarse, set uniform = true in [read.time] in place of "
            "'column' and 'unit'; if each reading was written several times, add [resample] with the rate of the "
            "readings"
        )
        return [AuditFinding("repeated_time", recording.label, what, remedy, repeated, error=True)]
    if repeated:
        kept = "resampling takes the last of them" if expected.resampled else "they are kept as separate rows"
        what = f"the time does not increase in {recording.name_rows(repeated)}: {kept}"
        remedy = (
            "remove the rows that were written twice; if the clock is too coarse, set uniform = true in [read.time] in "
            "place of 'column' and 'unit'"
        )
        found.append(AuditFinding("repeated_time", recording.label, what, remedy, repeated))
    return (
        _report_division(recording)
        + found
        + _check_rate(recording, steps, expected)
        + _report_uneven_steps(recording, steps, expected)
    )


def measure_rate(time: np.ndarray) -> float:
    """Return the typical rate of rows at these times [Hz]; 0 if time never increases."""
    steps = np.diff(time)
    return float(1 / np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


def find_holes(steps: np.ndarray, period: float) -> np.ndarray:
    """Return a mask of the steps [s] that are gaps in the measurement, shape (N,); `period` [s] is the typical step."""
    return np.asarray(steps > max(MISSING * period, SECONDS))


def _report_division(recording: Recording) -> list[AuditFinding]:
    """Report the gap before a recording's first row, at which its log was divided."""
    if not recording.gap:
        return []
    row = (int(recording.rows[0]),)
    what = (
        f"{recording.gap:.3g} s are missing before {recording.name_rows(row)}; the log is divided there into two "
        "episodes, because nothing was measured in between"
    )
    return [AuditFinding("time_gap", recording.label, what, rows=row)]


def _check_rate(recording: Recording, steps: np.ndarray, expected: Expected) -> list[AuditFinding]:
    """Compare the typical rate with the expected one."""
    whole = steps[(steps > 0) & ~find_holes(steps, max(float(np.median(steps)), 1 / expected.rate))]
    if not whole.size:
        return []
    rates = [float(1 / np.median(whole))]
    if len(whole) == len(steps):  # alternating steps have no representative median: a line through all is tried
        rates.append(1 / float(np.polyfit(np.arange(len(recording)), recording.time, 1)[0]))
    nearest = min(rates, key=lambda rate: abs(rate / expected.rate - 1))
    off = abs(nearest / expected.rate - 1)
    ratio = rates[0] / expected.rate
    gross = not 1 / RATE_FACTOR_REFUSED < ratio < RATE_FACTOR_REFUSED
    if off <= RATE_NOTED or (expected.resampled and not gross):
        return []
    refused = gross or off > RATE_REFUSED
    what = f"rows come at {rates[0] if refused else nearest:.6g} Hz, but {expected.promise} {expected.rate:.6g} Hz"
    remedy = "correct 'rate' or the unit of [read.time]" + ("" if gross else ", or add [resample]")
    return [AuditFinding("rate", recording.label, what, remedy, error=refused)]


def _report_uneven_steps(recording: Recording, steps: np.ndarray, expected: Expected) -> list[AuditFinding]:
    """Report gaps and uneven steps; with resampling, only gaps that interpolation would have to invent."""
    periods = steps * expected.rate
    if expected.resampled:
        gaps = list_row_numbers(recording.rows[1:], periods > GAP)
        if not gaps:
            return []
        what = f"up to {steps.max() * 1e3:.3g} ms pass before {recording.name_rows(gaps)}"
        remedy = "resampling fills these gaps with values that were not measured; to avoid this, split the log there"
        return [AuditFinding("time_gap", recording.label, what, remedy, gaps)]
    found = []
    holes = find_holes(steps, 1 / expected.rate) & find_holes(steps, float(np.median(steps)))
    rows = list_row_numbers(recording.rows[1:], holes)
    if rows:
        what = (
            f"{steps[holes].max():.3g} s are missing before {recording.name_rows(rows)}, in which nothing was measured"
        )
        found.append(AuditFinding("time_gap", recording.label, what, rows=rows, error=True))
    uneven = (np.abs(periods - 1) > expected.jitter + STEP_ROUNDING) & (steps > 0) & ~holes
    rows = list_row_numbers(recording.rows[1:], uneven)
    if not rows:
        return found
    what = (
        f"the step before {recording.name_rows(rows)} is {_format_milliseconds(steps[uneven])} ms "
        f"instead of {1e3 / expected.rate:.4g} ms"
    )
    derived = ", because velocities are derived as if they were" if expected.derived else ""
    remedy = f"add [resample] to the map to space rows evenly{derived}"
    minor = len(rows) <= TOLERATED_SHARE * len(steps)
    return [*found, AuditFinding("irregular_time", recording.label, what, remedy, rows, minor=minor)]


def _format_milliseconds(steps: np.ndarray) -> str:
    """Return the range of some steps, or their common length."""
    low, high = f"{steps.min() * 1e3:.4g}", f"{steps.max() * 1e3:.4g}"
    return low if low == high else f"{low} to {high}"
