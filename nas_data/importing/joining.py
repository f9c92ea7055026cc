"""Join of a log's tables on time: the row of each other table that belongs to a row with positions."""

from pathlib import Path

import numpy as np

from nas_data.errors import LogError
from nas_data.importing.map import Map
from nas_data.importing.table import LogTable


def join_table(time: np.ndarray, given: np.ndarray, table: LogTable, mapping: Map, method: str) -> np.ndarray:
    """Return for each row of the log the matching row of a table, whose times must ascend."""
    if not len(given):
        raise LogError(f"{table.path} holds no rows; give a log with recorded rows.")
    bad = np.flatnonzero(~(np.diff(given) >= 0)) + 1
    if bad.size:
        raise LogError(
            f"{table.path}: the time decreases or is not a number in {table.name_rows(bad)}; sort or repair the file."
        )
    return match_rows(time, given, method, mapping.layout.tolerance)


def choose_join(mapping: Map, table: str) -> str:
    """Return the join method of a table: nearest for positions of other joints, else the map's."""
    return "nearest" if table in mapping.position.source.tables else mapping.layout.join


def match_rows(wanted: np.ndarray, given: np.ndarray, method: str, tolerance: float) -> np.ndarray:
    """Find the row of another table for each wanted time.

    Args:
        wanted: Times [s], shape (N,).
        given: Times of the other table in ascending order [s], shape (M,).
        method: `nearest` row, or the `previous` one (the last at or before the wanted time).
        tolerance: Largest difference [s].

    Returns:
        Rows of the other table, shape (N,); -1 if none is within the tolerance.
    """
    before = np.searchsorted(given, wanted, side="right") - 1
    rows = np.clip(before, 0, len(given) - 1)
    if method == "nearest":
        after = np.clip(before + 1, 0, len(given) - 1)
        rows = np.where(np.abs(given[after] - wanted) < np.abs(given[rows] - wanted), after, rows)
    distance = np.abs(given[rows] - wanted)
    found = (distance <= tolerance) & ((method == "nearest") | (before >= 0))
    return np.where(found, rows, -1)


def find_common_rows(matches: dict[Path, np.ndarray], log: Path, table: LogTable, tolerance: float) -> slice:
    """Return the rows that have a match in every table; only rows at the ends may lack one.

    Args:
        matches: For each other file, its matching row for each row of the log, -1 for none.
        log: The log, for the error message.
        table: The table with the positions, for the error message.
        tolerance: Largest difference of joined times [s], for the error message.

    Raises:
        LogError: a file has no match for rows in the middle, or for any row.
    """
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
            "raise the tolerance of [join], or join with the previous row."
        )
    return whole
