"""Join of a log's tables on time: the row of each other table that belongs to a row with positions."""

from pathlib import Path

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.map import Map
from nas_data.importing.messages import RECEIVED
from nas_data.importing.table import LogTable

# Remedy for messages whose own times are out of order.
BY_RECEIPT = f"take the times of receipt, which ascend: column = '{RECEIVED}' and unit = 'ns' in [read.time]"
UNMATCHED_REFUSED = 0.5  # share of a log without a match at its ends above which it is refused


def join_table(time: np.ndarray, given: np.ndarray, table: LogTable, mapping: Map, key: str) -> np.ndarray:
    """Return for each row of the log the matching row of a table, whose times must ascend.

    Args:
        time: Times of the rows with positions [s], shape (N,).
        given: Times of the table [s], shape (M,).
        table: The table.
        mapping: The map.
        key: Name of the table in the map.
    """
    if not len(given):
        raise LogError(f"{table.path} holds no rows; give a log with recorded rows.")
    bad = np.flatnonzero(~(np.diff(given) >= 0)) + 1
    if bad.size:
        remedy = BY_RECEIPT if mapping.layout.topics else "sort or repair the file"
        raise LogError(f"{table.path}: the time decreases or is not a number in {table.name_rows(bad)}; {remedy}.")
    # Positions of further joints belong to the same moment, whatever the join of the commands.
    method = "nearest" if key in mapping.position.source.tables else mapping.layout.join
    commanded = any(part.table == key for part in mapping.command.source.parts)
    ahead = _measure_half_steps(time) if commanded and mapping.alignment == "action_follows_state" else 0.0
    return match_rows(time, given, method, mapping.layout.tolerance, ahead)


def _measure_half_steps(time: np.ndarray) -> np.ndarray:
    """Return half the step after each row, at most half the typical step [s], shape (N,)."""
    steps = np.clip(np.diff(time), 0.0, None)
    typical = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    return np.minimum(np.append(steps, typical), typical) / 2


def match_rows(
    wanted: np.ndarray, given: np.ndarray, method: str, tolerance: float, ahead: np.ndarray | float = 0.0
) -> np.ndarray:
    """Find the row of another table for each wanted time.

    A controller reads a state and sends its command some milliseconds later. This command acts in the step after the
    state, so it belongs to its row. Where a command acts after its state, the last one before the middle of the step
    is therefore taken, as in resampling: `ahead` is half a step.

    Args:
        wanted: Times [s], shape (N,).
        given: Times of the other table in ascending order [s], shape (M,).
        method: `nearest` row, or the `previous` one (the last at or before the wanted time).
        tolerance: Largest difference [s].
        ahead: Time by which the previous row may be later than the wanted time [s], one for all or shape (N,).

    Returns:
        Rows of the other table, shape (N,); -1 if none is within the tolerance.
    """
    latest = wanted + (ahead if method == "previous" else 0.0)
    before = np.searchsorted(given, latest, side="right") - 1
    rows = np.clip(before, 0, len(given) - 1)
    if method == "nearest":
        after = np.clip(before + 1, 0, len(given) - 1)
        rows = np.where(np.abs(given[after] - wanted) < np.abs(given[rows] - wanted), after, rows)
    distance = np.abs(given[rows] - wanted)
    found = (distance <= tolerance) & ((method == "nearest") | (before >= 0))
    return np.where(found, rows, -1)


def find_common_rows(matches: dict[Path, np.ndarray], log: Path, table: LogTable, layout: LogLayout) -> slice:
    """Return the rows that have a match in every table; only rows at the ends may lack one.

    Args:
        matches: For each other file, its matching row for each row of the log, -1 for none.
        log: The log, for the error message.
        table: The table with the positions, for the error message.
        layout: Method and tolerance of the join, for the error message.

    Raises:
        LogError: a file has no match for rows in the middle, or for any row.
    """
    tolerance = layout.tolerance
    missing = np.any([rows < 0 for rows in matches.values()], axis=0)
    found = np.flatnonzero(~missing)
    if not found.size:
        names = ", ".join(path.name for path in matches)
        raise LogError(
            f"{log}: no row of {names} is within {tolerance:g} s of a measured state; "
            "check the unit of [read.time] and the tolerance of [join]."
        )
    whole = slice(int(found[0]), int(found[-1]) + 1)
    holes = np.flatnonzero(missing[whole]) + whole.start
    if holes.size:
        path = next(path for path, rows in matches.items() if rows[holes[0]] < 0)
        raise LogError(
            f"{log}: {path.name} has nothing within {tolerance:g} s of {table.name_rows(holes)}; "
            f"raise the tolerance of [join]{', or join with the previous row' if layout.join == 'nearest' else ''}."
        )
    return whole


def report_ends(
    matches: dict[Path, np.ndarray], common: slice, log: Path, table: LogTable, time: np.ndarray, tolerance: float
) -> list[AuditFinding]:
    """Return findings on the rows at both ends that are left out; errors if these are much of the log.

    Args:
        matches: For each other file, its matching row for each row of the log, -1 for none.
        common: The rows that are kept.
        log: The log.
        table: The table with the positions.
        time: Its times [s], shape (N,).
        tolerance: Largest difference of joined times [s].
    """
    last = len(time) - 1
    ends = {
        "first": (np.arange(common.start), time[common.start] - time[0]),
        "last": (np.arange(common.stop, last + 1), time[last] - time[common.stop - 1]),
    }
    refused = len(time) - (common.stop - common.start) > UNMATCHED_REFUSED * len(time)
    found = []
    for end, (rows, seconds) in ends.items():
        if not rows.size:
            continue
        names = ", ".join(path.name for path, matching in matches.items() if (matching[rows] < 0).any())
        what = (
            f"the {end} {seconds:.3g} s, {table.name_rows(rows)}, have nothing in {names} within {tolerance:g} s and "
            "are left out"
        )
        remedy = ""
        if refused:
            remedy = (
                "add allow = ['unmatched_ends'] to [audit] to import the rest, or raise the tolerance of [join] if a "
                "command holds until the next one"
            )
        numbers = rows if table.rows is None else table.rows[rows]
        found.append(AuditFinding("unmatched_ends", str(log), what, remedy, tuple(numbers.tolist()), error=refused))
    return found
