"""Make robots.md from robots.csv.

Run `python docs/results/robots.py`. With options it first adds a run of `nas gap`; the commands are in robots.md.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tyro
from pages import HERE, Row, markdown_table, number, read_table, render, write_page, write_table

# [°] fits by hand; [s] pieces of a recording; ± 6 % of a plain fit; factors on a mass
GIVEN = {"5.7", "0.66", "3.2", "0.94", "1.06", "0.8", "0.6"}
ROBOTS = {  # name in the table: on the page
    "miuzei_servo": "Miuzei servo with a weighted arm",
    "dfki_double_pendulum": "double pendulum, two AK80-6",
    "go2_legs": "Go2's twelve legs, in the air",
    "bam_xl330": "XL330 with a pendulum",
    "sage_so101": "SO-101",
}
METHODS = ("given model", "plain fit", "names", "names / plain fit")
CHANGES = {  # beginning of the names of known changes: on the page
    "XL330: P gain": "XL330: position gain, one register to another of 100, 200, 400 and 800",
    "double pendulum: mass": "double pendulum: mass of the last link in the model",
    "double pendulum: no": "double pendulum: friction of a joint in the model",
    "XL330, commands": "XL330: commands 1, 2 or 3 samples late",
    "XL330, readings": "XL330: readings 1°, 2° or 4° larger",
    "SO-101, commands": "SO-101: commands of a joint 1, 2 or 3 samples late",
    "SO-101, readings": "SO-101: readings of a joint 1°, 2° or 4° larger",
}
NEAR = 0.15  # largest relative error of the size of a known change
HELD_OUT, KEPT = "held-out episodes", "kept back"


class Robots:
    """What the table says, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        self._rows = read_table(folder / "robots.csv")
        self._changes = read_table(folder / "known_changes.csv")
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

    def changes_table(self) -> str:
        """Return the table of known changes by kind."""
        kinds = {kind: [row for row in self._changes if row["change"].startswith(kind)] for kind in CHANGES}
        rows = []
        for kind, words in CHANGES.items():
            (commit,) = {row["commit"] for row in kinds[kind]}
            rows.append([words, *count_changes(kinds[kind]), f"`{commit}`"])
        return markdown_table(
            ["change", "made", "named", "size within 15 %", "interval holds the size", "wrong names", "commit"], rows
        )

    def missed_table(self) -> str:
        """Return the table of changes that were not named, or with another size."""
        rows = []
        for row in self._changes:
            if not is_near(row):
                found = number(float(row["found"]), 3) if row["found"] else "–"
                rows.append([row["change"], number(float(row["size"]), 3), found, row["confidence"] or "–"])
        return markdown_table(["change", "true", "found", "confidence"], rows)

    def surest_wrong(self) -> str:
        """Return the largest confidence of a name that is no change."""
        beside = [name for row in self._changes if row["beside"] for name in row["beside"].split("; ")]
        return max((name.rsplit(" ", 1)[1] for name in beside), default="–")

    def changes_right(self) -> str:
        """Return the number of changes named with a size within 15 %, of all."""
        return f"{sum(map(is_near, self._changes))} of {len(self._changes)}"

    def most_sure(self) -> str:
        """Return the largest confidence of a name."""
        return number(max(float(row["confidence"]) for row in self._rows if row["confidence"]), 2)


def is_near(row: Row) -> bool:
    """Whether a known change is named with a size within 15 %."""
    return bool(row["found"]) and abs(float(row["found"]) / float(row["size"]) - 1) <= NEAR


def count_changes(rows: Sequence[Row]) -> list[str]:
    """Return the numbers of changes made, named, with a size within 15 % and with an interval that holds the size.

    The last number is that of the names that are no change.
    """
    named = [row for row in rows if row["found"]]
    held = [row for row in named if float(row["low"]) <= float(row["size"]) <= float(row["high"])]
    beside = [name for row in rows if row["beside"] for name in row["beside"].split("; ")]
    return [str(len(part)) for part in (rows, named, list(filter(is_near, rows)), held, beside)]


def degrees(error: float | None) -> str:
    """Return an error with its unit, a dash where none is known."""
    return "–" if error is None else f"{number(error, 2)}°"


def make_page(folder: Path) -> str:
    """Return the page that the table of a folder makes."""
    return render(folder / "robots.md.j2", Robots(folder))


def list_rows(robot: str, run: Path, model: str, given: Path, kept: Path | None) -> list[dict[str, object]]:
    """Return the table's rows of one run: its held-out episodes, and recordings that it was not given."""
    import nas_data as nas
    from nas_data.runs.environment_info import find_commit

    report = nas.GapReport.load(run)
    gap = report.gap
    sure = max((effect.confidence for effect in report.effects), default=None)
    known = {"robot": robot, "seed": report.seed, "commit": (find_commit() or "")[:7], "unit": "deg"}
    held = {"given": gap.before, "plain": gap.plain, "names": gap.after}
    count, seconds = len(report.episodes.heldout), round(report.seconds)
    rows: list[dict[str, object]] = [
        {**known, "experiment": "held-out episodes", "method": method, "count": count, "time": seconds}
        | {"open_loop": round(math.degrees(error), 3), "confidence": sure}
        for method, error in held.items()
        if error is not None
    ]
    if kept is not None:
        rows += [
            {**known, "experiment": "kept back", "method": method, "count": len(nas.Dataset.load(kept).lengths)}
            | {"open_loop": round(math.degrees(error), 3), "time": "", "confidence": ""}
            for method, error in judge_on_kept(run, model, given, kept).items()
        ]
    return rows


def judge_on_kept(run: Path, model: str, given: Path, kept: Path) -> dict[str, float]:
    """Return open-loop errors [rad] by method; the plain fit is made of what the run was given."""
    import nas_data as nas
    from nas_data.api.arguments import find_folder
    from nas_data.gap.plain_source import fit_plain_source
    from nas_data.models.evaluation import evaluate

    recorded, fitted = nas.Dataset.load(kept), nas.Dataset.load(given)
    found = nas.evaluate(run / "model.xml", recorded, model=model, plain_fit=False).open_loop
    simulator = fit_plain_source(fitted, model, find_folder(fitted), print)
    plain = evaluate(recorded, simulator, None).open_loop["source"]
    return {"given": found["source"].overall, "plain": plain.overall, "names": found["model"].overall}


def add_run(robot: str, run: Path, model: str, given: Path, kept: Path | None = None) -> None:
    """Write the rows of one run to robots.csv, in the place of former ones of that robot, and make the page.

    Args:
        robot: Name of the robot in the table.
        run: Folder of the gap report.
        model: Given model.
        given: Dataset that the run was given.
        kept: Dataset that the run was not given.
    """
    table = HERE / "robots.csv"
    before = [row for row in read_table(table) if row["robot"] != robot] if table.exists() else []
    order = ("experiment", "robot", "method", "count", "seed", "commit", "unit", "open_loop", "time", "confidence")
    rows = [*before, *list_rows(robot, run, model, given, kept)]
    write_table(table, [{key: row[key] for key in order} for row in rows])
    write_page("robots", make_page(HERE), {})


if __name__ == "__main__":
    tyro.cli(add_run) if len(sys.argv) > 1 else write_page("robots", make_page(HERE), {})
