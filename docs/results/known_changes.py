"""Make known_changes.md from known_changes.csv, which known_changes_run.py writes.

Run `python docs/results/known_changes.py`.
"""

from pathlib import Path

from pages import HERE, Row, markdown_table, number, read_table, render, write_page

CLOSE = 0.15  # relative error up to which a size counts as right
ARMS = {"XL330": "P gain of an XL330", "double pendulum": "mass of a double pendulum", "SO-101": "SO-101"}
UNITS = {  # effect: factor and unit in which its size is shown
    "servo_stiffness": (1.0, ""), "payload": (1.0, " kg"), "command_delay": (1000.0, " ms"),
    "joint_offset": (57.29578, "°"),
}  # fmt: skip


class KnownChanges:
    """What the table says, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._rows = read_table(folder / "known_changes.csv")

    def commit(self) -> str:
        """Return the commit that made the table."""
        return ", ".join(f"`{commit}`" for commit in sorted({row["commit"] for row in self._rows}))

    def summary(self) -> str:
        """Return the table of counts by kind of change."""
        heads = ["change", "made", "named right", "size within 15 %", "interval contains the size", "other names, mean"]
        kinds = {(arm, row["effect"]): words for arm, words in ARMS.items() for row in self._rows if is_of(row, arm)}
        rows = []
        for (arm, effect), words in kinds.items():
            own = [row for row in self._rows if is_of(row, arm) and row["effect"] == effect]
            rows.append([f"{words}: `{effect}`", *count(own)])
        return markdown_table(heads, [*rows, ["together", *count(self._rows)]])

    def details(self) -> str:
        """Return the table of all changes."""
        heads = ["change", "size", "found", "95 % interval", "confidence", "other names (confidence)"]
        return markdown_table(heads, [tell(row) for row in self._rows])


def is_of(row: Row, arm: str) -> bool:
    """Whether a change was made in an arm."""
    return row["change"].startswith(arm)


def count(rows: list[Row]) -> list[str]:
    """Return how many changes there are, are named, have the right size, and how many other names there are."""
    named = [row for row in rows if row["found"]]
    right = [row for row in named if abs(float(row["found"]) / float(row["size"]) - 1) <= CLOSE]
    held = [row for row in named if float(row["low"]) <= float(row["size"]) <= float(row["high"])]
    others = sum(len(list_others(row)) for row in rows) / max(1, len(rows))
    return [*(str(len(part)) for part in (rows, named, right, held)), number(others, 1)]


def list_others(row: Row) -> list[str]:
    """Return the names beside the change."""
    return [name for name in row["beside"].split("; ") if name]


def tell(row: Row) -> list[str]:
    """Return the row of a change."""
    factor, unit = UNITS[row["effect"]]
    values = {key: float(row[key]) * factor for key in ("size", "found", "low", "high") if row[key]}
    texts = {key: number(value, 2) for key, value in values.items()}
    found = (
        [f"{texts['found']}{unit}", f"[{texts['low']}, {texts['high']}]", row["confidence"]]
        if row["found"]
        else ["not named", "", ""]
    )
    others = ", ".join(name.replace("_", " ") for name in list_others(row))
    return [row["change"], f"{texts['size']}{unit}", *found, others]


def make_page(folder: Path) -> str:
    """Return the page that the table of a folder makes."""
    return render(folder / "known_changes.md.j2", KnownChanges(folder))


if __name__ == "__main__":
    write_page("known_changes", make_page(HERE), {})
