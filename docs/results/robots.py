"""Make robots.md from robots.csv.

Run `python docs/results/robots.py`.
"""

from pathlib import Path

import numpy as np
from pages import HERE, markdown_table, number, read_table, render, write_page

GIVEN = {"5.7", "0.66", "3.2", "0.94", "1.06"}  # [°] fits by hand; [s] pieces of a recording; ± 6 % of a plain fit
ROBOTS = {  # name in the table: on the page
    "miuzei_servo": "Miuzei servo with a weighted arm",
    "dfki_double_pendulum": "double pendulum, two AK80-6",
    "go2_legs": "Go2's twelve legs, in the air",
    "bam_xl330": "XL330 with a pendulum",
    "sage_so101": "SO-101",
}
METHODS = ("given model", "plain fit", "names", "names / plain fit")
HELD_OUT, KEPT = "held-out episodes", "kept back"


class Robots:
    """What the table says, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._rows = read_table(folder / "robots.csv")
        self._errors: dict[tuple[str, str, str], list[float]] = {}  # [°] by experiment, robot and method
        for row in self._rows:
            key = row["experiment"], row["robot"], row["method"]
            self._errors.setdefault(key, []).append(float(row["open_loop"]))

    def commit(self) -> str:
        """Return the commit that made the table."""
        (commit,) = {row["commit"] for row in self._rows}
        return f"`{commit}`"

    def _robots(self) -> list[str]:
        return [robot for robot in ROBOTS if (HELD_OUT, robot, "names") in self._errors]

    def _mean(self, experiment: str, robot: str, method: str) -> float | None:
        found = self._errors.get((experiment, robot, method))
        return None if found is None else float(np.mean(found))

    def _ratios(self) -> list[float]:
        errors = self._errors
        return [
            float(np.mean(np.divide(errors[HELD_OUT, robot, "names"], errors[HELD_OUT, robot, "plain"])))
            for robot in self._robots()
        ]

    def errors_table(self) -> str:
        """Return the table of errors and times by robot."""
        rows = []
        for robot, ratio in zip(self._robots(), self._ratios(), strict=True):
            held = [self._mean(HELD_OUT, robot, method) for method in ("given", "plain", "names")]
            rows.append([ROBOTS[robot], *map(degrees, held), number(ratio, 2)])
        return markdown_table(["robot", *METHODS], rows)

    def kept_table(self) -> str:
        """Return the table of errors on recordings that no run was given."""
        rows = []
        for robot in self._robots():
            kept = [self._mean(KEPT, robot, method) for method in ("given", "plain", "names")]
            if kept[1] is not None and kept[2] is not None:
                rows.append([ROBOTS[robot], *map(degrees, kept), number(kept[2] / kept[1], 2)])
        return markdown_table(["robot", *METHODS], rows)

    def count(self) -> str:
        """Return the number of robots."""
        return str(len(self._robots()))

    def median_ratio(self) -> str:
        """Return the median over robots of names' error over the plain fit's."""
        return number(float(np.median(self._ratios())), 2)

    def largest_ratio(self) -> str:
        """Return the largest of these."""
        return number(max(self._ratios()), 2)

    def most_sure(self) -> str:
        """Return the largest confidence of a name."""
        return number(max(float(row["confidence"]) for row in self._rows if row["confidence"]), 2)


def degrees(error: float | None) -> str:
    """Return an error with its unit, a dash where none is known."""
    return "–" if error is None else f"{number(error, 2)}°"


def make_page(folder: Path) -> str:
    """Return the page that the table of a folder makes."""
    return render(folder / "robots.md.j2", Robots(folder))


if __name__ == "__main__":
    write_page("robots", make_page(HERE), {})
