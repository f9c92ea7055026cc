"""Make xl330.md from xl330.csv and xl330_names.csv.

Run `python docs/results/xl330.py`.
"""

from pathlib import Path

import numpy as np
from pages import HERE, markdown_table, number, read_table, render, write_page

GIVEN = {"7.4", "6.1"}  # [V] the motor's supply, as recorded
MODELS = {
    "frictionless": "frictionless",
    "authors": "authors' M1",
    "refitted": "M1, fitted without this trajectory",
    "named": "named",
}
DIGITS = {"": 3, "N·m·s/rad": 4, "rad": 3}


class Xl330:
    """What the tables say, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._names = read_table(folder / "xl330_names.csv")
        self._commits: set[str] = set()
        self._errors: dict[str, dict[str, float]] = {}  # [°] by log and method
        for row in read_table(folder / "xl330.csv"):
            self._errors.setdefault(row["log"], {})[row["method"]] = float(row["open_loop"])
            self._commits.add(row["commit"])

    def commit(self) -> str:
        """Return the commit that made the table."""
        (commit,) = self._commits
        return f"`{commit}`"

    def errors_table(self) -> str:
        """Return the table of errors by held-out log, the least of each in bold."""
        logs = sorted(self._errors, key=lambda log: (log.split()[0], int(log.split("=")[1])))
        rows = [self._row(log.replace(" kp=", ", P "), [self._errors[log][name] for name in MODELS]) for log in logs]
        rows.append(self._row("median", [self._median(name) for name in MODELS]))
        return markdown_table(["held-out log", *MODELS.values()], rows)

    def _row(self, name: str, errors: list[float]) -> list[str]:
        texts = [f"{error:.2f}" for error in errors]
        return [name, *(f"**{text}**" if text == f"{min(errors):.2f}" else text for text in texts)]

    def _median(self, model: str) -> float:
        return float(np.median([errors[model] for errors in self._errors.values()]))

    def median(self, model: str) -> str:
        """Return the median error of a model [°]."""
        return f"{number(self._median(model), 2)}°"

    def better(self) -> str:
        """Return on how many logs the names are better than the authors' numbers."""
        return str(sum(errors["named"] < errors["authors"] for errors in self._errors.values()))

    def count(self) -> str:
        """Return the number of logs."""
        return str(len(self._errors))

    def names_table(self) -> str:
        """Return the table of names by held-out trajectory."""
        told: dict[str, list[str]] = {}
        for row in self._names:
            digits = DIGITS[row["unit"]]
            value, low, high = (number(float(row[key]), digits) for key in ("value", "low", "high"))
            unit = f" {row['unit']}" if row["unit"] else ""
            effect, sure = row["effect"].replace("_", " "), number(float(row["confidence"]), 2)
            told.setdefault(row["held_out"], []).append(f"{effect} {value}{unit} [{low}, {high}], {sure}")
        order = ("sin_sin", "lift_and_drop", "up_and_down")
        rows = [[name, "; ".join(told[name])] for name in order]
        return markdown_table(["named without", "names, 95 % intervals, confidence"], rows)

    def most_sure(self) -> str:
        """Return the largest confidence of a name."""
        return number(max(float(row["confidence"]) for row in self._names), 2)


def make_page(folder: Path) -> str:
    """Return the page that the tables of a folder make."""
    return render(folder / "xl330.md.j2", Xl330(folder))


if __name__ == "__main__":
    write_page("xl330", make_page(HERE), {})
