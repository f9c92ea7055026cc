"""Make ergo_reacher.md from ergo_reacher.csv and ergo_reacher_names.csv.

Run `python docs/results/ergo_reacher.py`.
"""

from pathlib import Path

import numpy as np
from pages import HERE, markdown_table, number, numbers, read_table, render, write_page

from nas_data.policies.intervals import compute_share

GIVEN = {"0.12", "0.01", "0.2", "0.05"}  # of the target and of the recording
STUDY, AGAIN = "ErgoReacher-backlash", "ErgoReacher-backlash again"  # experiments of the table
TRUE_EFFECTS = ("speed_limit", "backlash")
METHODS = {
    "expert": "target",
    "source": "source",
    "nas": "source + φ",
    "forward": "ψ",
    "named": "source + named effects",
    "named_nas": "source + named effects + φ",
}


class ErgoReacher:
    """What the tables say, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._runs, self._names = read_table(folder / "ergo_reacher.csv"), read_table(folder / "ergo_reacher_names.csv")

    def _values(self, method: str, column: str = "return", experiment: str = STUDY) -> np.ndarray:
        rows = [row for row in self._runs if (row["method"], row["experiment"]) == (method, experiment)]
        return np.array([float(row[column]) for row in rows])

    def methods_table(self) -> str:
        """Return the table of methods."""
        rows = []
        for method, label in METHODS.items():
            values, rate = self._values(method), np.median(self._values(method, "success_rate"))
            closed = "" if method in ("expert", "source") else self.closed(method)
            ends = f"{number(values.min(), 2)} … {number(values.max(), 2)}"
            rows.append(
                [f"`{method}`", label, number(float(np.median(values)), 2), ends, f"{100 * rate:.0f} %", closed]
            )
        heads = ["method", "learned on", "return: median", "min … max", "success", "distance closed [95 %]"]
        return markdown_table(heads, rows)

    def closed(self, method: str) -> str:
        """Return the share of the distance from source to expert that a method closes, with its interval."""
        found = compute_share(*map(self._values, (method, "source", "expert")))
        return f"{100 * found.value:.0f} % [{100 * found.low:.0f}, {100 * found.high:.0f}]"

    def returns(self, method: str) -> str:
        """Return the return of each seed."""
        return numbers(self._values(method), 2)

    def named(self, commit: str, effect: str, digits: int) -> str:
        """Return what was found of an effect, a number a joint, in the order of the joints."""
        rows = [row for row in self._names if (row["commit"], row["effect"]) == (commit, effect)]
        return numbers((float(row["value"]) for row in sorted(rows, key=lambda row: row["joint"])), digits)

    def confidence(self, commit: str, effect: str) -> str:
        """Return the confidence of an effect, the least and the largest if joints differ."""
        rows = [row for row in self._names if (row["commit"], row["effect"]) == (commit, effect)]
        ends = {number(float(row["confidence"]), 2): None for row in sorted(rows, key=lambda row: row["confidence"])}
        least, *_, most = [*ends, *ends]
        return least if least == most else f"{least} to {most}"

    def most_wrong(self) -> str:
        """Return the largest confidence of a name that is not true."""
        wrong = (row for row in self._names if row["confidence"] and row["effect"] not in TRUE_EFFECTS)
        return number(max(float(row["confidence"]) for row in wrong), 2)

    def later(self, method: str) -> str:
        """Return the return of the policy that learned later."""
        return numbers(self._values(method, experiment=AGAIN), 2)


def make_page(folder: Path) -> str:
    """Return the page that the tables of a folder make."""
    return render(folder / "ergo_reacher.md.j2", ErgoReacher(folder))


if __name__ == "__main__":
    write_page("ergo_reacher", make_page(HERE), {})
