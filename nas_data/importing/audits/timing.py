"""Time: it must go on, at the map's rate, in even steps."""

import numpy as np

from nas_data.importing.finding import Finding, row_numbers
from nas_data.importing.map import Map
from nas_data.importing.recording import Recording
from nas_data.importing.rows import rows_text

RATE_NOTED = 0.005  # relative deviation of the rate that is reported …
RATE_REFUSED = 0.05  # … and that is refused where rows stay as recorded
RATE_FACTOR_REFUSED = 3.0  # … and where they are resampled: seconds taken for milliseconds, not a slower loop
GAP = 2.0  # [periods] step that resampling cannot honestly fill


def check(recording: Recording, mapping: Map) -> list[Finding]:
    """Report rows whose time goes back, stands still or jumps, and a rate that is not the map's."""
    if not np.isfinite(recording.time).all():
        return []
    steps = np.diff(recording.time)
    back = row_numbers(recording.rows[1:], steps < 0)
    if back:
        message = f"the time goes back in {rows_text(back)}; sort the rows, or split the log there."
        return [Finding("time_backwards", recording.place, message, back, error=True)]
    found = []
    repeated = row_numbers(recording.rows[1:], steps == 0)
    if len(repeated) == len(steps):
        message = "the time is the same in all rows; name the time column in [read.time]."
        return [Finding("repeated_time", recording.place, message, repeated, error=True)]
    if repeated:
        kept = "resampling takes the last of them" if mapping.resample else "they are kept as rows of their own"
        message = f"the time does not go on in {rows_text(repeated)}: {kept}."
        found.append(Finding("repeated_time", recording.place, message, repeated))
    return _gap(recording) + found + _rate(recording, steps, mapping) + _steps(recording, steps, mapping)


def _gap(recording: Recording) -> list[Finding]:
    """Report the hole before a recording's first row, at which its log was divided."""
    if not recording.gap:
        return []
    row = (int(recording.rows[0]),)
    message = (
        f"{recording.gap:.3g} s are missing before {rows_text(row)}; the log is divided there into two episodes, "
        "because nothing was measured in between."
    )
    return [Finding("time_gap", recording.place, message, row)]


def _rate(recording: Recording, steps: np.ndarray, mapping: Map) -> list[Finding]:
    """Compare the median step with the map's rate."""
    rate = float(1 / np.median(steps[steps > 0]))
    ratio = rate / mapping.rate
    gross = not 1 / RATE_FACTOR_REFUSED < ratio < RATE_FACTOR_REFUSED
    off = abs(ratio - 1)
    if off <= RATE_NOTED or (mapping.resample and not gross):
        return []
    remedy = "correct 'rate' or the unit of [read.time]" + ("." if gross else ", or add [resample].")
    message = f"rows come at {rate:.6g} Hz, but the map says {mapping.rate:.6g} Hz; {remedy}"
    refused = gross or off > RATE_REFUSED
    return [Finding("rate", recording.place, message, error=refused)]


def _steps(recording: Recording, steps: np.ndarray, mapping: Map) -> list[Finding]:
    """Report uneven steps; where rows are resampled only gaps that interpolation would have to invent."""
    periods = steps * mapping.rate
    if mapping.resample:
        gaps = row_numbers(recording.rows[1:], periods > GAP)
        if not gaps:
            return []
        message = (
            f"up to {steps.max() * 1e3:.3g} ms pass before {rows_text(gaps)}; "
            "what resampling puts there was never measured."
        )
        return [Finding("time_gap", recording.place, message, gaps)]
    uneven = (np.abs(periods - 1) > mapping.thresholds.jitter) & (steps > 0)
    rows = row_numbers(recording.rows[1:], uneven)
    if not rows:
        return []
    message = (
        f"the step before {rows_text(rows)} is {_milliseconds(steps[uneven])} ms "
        f"instead of {1e3 / mapping.rate:.4g} ms; add [resample] to the map to space rows evenly"
        + (", because velocities are derived as if they were." if mapping.derive_velocity else ".")
    )
    return [Finding("irregular_time", recording.place, message, rows)]


def _milliseconds(steps: np.ndarray) -> str:
    """Return the range of some steps, or their one length."""
    low, high = f"{steps.min() * 1e3:.4g}", f"{steps.max() * 1e3:.4g}"
    return low if low == high else f"{low} to {high}"
