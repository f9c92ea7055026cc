"""Naming rows of a log in a sentence; rows count from 0 at the first row of data."""

from collections.abc import Sequence

import numpy as np

SHOWN = 5


def spans(rows: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
    """Return runs of consecutive rows as (first, last)."""
    rows = np.asarray(rows, dtype=np.int64)
    if rows.size == 0:
        return []
    breaks = np.flatnonzero(np.diff(rows) != 1)
    firsts = rows[np.concatenate([[0], breaks + 1])]
    lasts = rows[np.concatenate([breaks, [rows.size - 1]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def rows_text(rows: Sequence[int] | np.ndarray) -> str:
    """Return rows as people write them: `row 3`, `rows 3–7, 12, 15, 20, 31 and 40 more places`."""
    runs = spans(rows)
    words = [str(first) if first == last else f"{first}–{last}" for first, last in runs[:SHOWN]]
    more = len(runs) - SHOWN
    places = "1 more place" if more == 1 else f"{more} more places"
    noun = "row" if len(rows) == 1 else "rows"
    return f"{noun} {', '.join(words)}" + (f" and {places}" if more > 0 else "")
