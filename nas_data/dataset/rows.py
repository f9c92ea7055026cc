"""Row numbers of a log in messages; rows count from 0 at the first row of data, lines of a file from 1."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

SHOWN = 5


@dataclass(frozen=True)
class TextLines:
    """Line numbers of the rows of a text file.

    Attributes:
        path: The file: a header, then one line per row. Empty lines are skipped.
        count: Number of rows.
    """

    path: Path
    count: int

    @cached_property
    def numbers(self) -> np.ndarray:
        """Line of each row, shape (N,); empty if rows span several lines, because line numbers are then uncertain."""
        lines = self.path.read_bytes().splitlines()
        filled = np.flatnonzero(np.array([bool(line) for line in lines])) + 1
        return filled[1:] if len(filled) == self.count + 1 else filled[:0]


def find_row_spans(rows: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
    """Return runs of consecutive rows as (first, last)."""
    rows = np.asarray(rows, dtype=np.int64)
    if rows.size == 0:
        return []
    breaks = np.flatnonzero(np.diff(rows) != 1)
    firsts = rows[np.concatenate([[0], breaks + 1])]
    lasts = rows[np.concatenate([breaks, [rows.size - 1]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def format_rows(rows: Sequence[int] | np.ndarray, lines: TextLines | None = None) -> str:
    """Format row numbers, with the lines of the file if known.

    `row 3 (counted from 0)`, `rows 3–7, 12, 15, 20, 31 and 40 more places (counted from 0)`, or, for a text file,
    `row 3 (line 5 of log.csv)`, `rows 3–7, 12 (lines 5–9, 14 of log.csv)`.

    Args:
        rows: Row numbers, counted from 0, ascending.
        lines: Lines of the rows in a text file; None for other logs.
    """
    runs = find_row_spans(rows)[:SHOWN]
    more = len(find_row_spans(rows)) - SHOWN
    places = "1 more place" if more == 1 else f"{more} more places"
    named = _format_numbers("row", runs) + (f" and {places}" if more > 0 else "")
    if lines is None or not lines.numbers.size:
        return f"{named} (counted from 0)"
    there = [(int(lines.numbers[first]), int(lines.numbers[last])) for first, last in runs]
    return f"{named} ({_format_numbers('line', there)}{' …' if more > 0 else ''} of {lines.path.name})"


def _format_numbers(noun: str, runs: Sequence[tuple[int, int]]) -> str:
    """Return runs of numbers after their noun: `row 3`, `rows 3–7, 12`."""
    words = [str(first) if first == last else f"{first}–{last}" for first, last in runs]
    one = len(runs) == 1 and runs[0][0] == runs[0][1]
    return f"{noun if one else f'{noun}s'} {', '.join(words)}"
