"""A finding: one thing that an audit noticed in one log, with its rows."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Finding:
    """What an audit says.

    Attributes:
        check: What was checked, for example `irregular_time`.
        file: The log, with the episode where it holds several.
        message: One sentence: what was found, and the remedy where there is one.
        rows: Rows concerned, counted from 0 at the log's first row of data; empty where all are.
        error: Whether the log is refused; else it is imported and the finding kept with the dataset.
    """

    check: str
    file: str
    message: str
    rows: tuple[int, ...] = ()
    error: bool = False

    def to_json(self) -> dict[str, object]:
        """Return the form for machines."""
        return {
            "check": self.check,
            "file": self.file,
            "rows": list(self.rows),
            "count": len(self.rows),
            "message": self.message,
            "severity": "error" if self.error else "warning",
        }


def row_numbers(rows: np.ndarray, chosen: np.ndarray) -> tuple[int, ...]:
    """Return the log's row numbers of the chosen rows (a mask or indices)."""
    return tuple(int(row) for row in rows[chosen])
