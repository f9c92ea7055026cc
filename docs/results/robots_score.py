"""Add a run of `nas gap` on a real robot to robots.csv; the commands are in robots.md."""

import math
from pathlib import Path

import tyro
from pages import HERE, read_table, write_table

import nas_data as nas
from nas_data.api.arguments import find_folder
from nas_data.gap.plain_source import fit_plain_source
from nas_data.models.evaluation import evaluate
from nas_data.runs.environment_info import find_commit


def list_rows(robot: str, run: Path, model: str, given: Path, kept: Path | None) -> list[dict[str, object]]:
    """Return the table's rows of one run: its held-out episodes, and recordings that it was not given."""
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
    recorded, fitted = nas.Dataset.load(kept), nas.Dataset.load(given)
    found = nas.evaluate(run / "model.xml", recorded, model=model, plain_fit=False).open_loop
    simulator = fit_plain_source(fitted, model, find_folder(fitted), print)
    plain = evaluate(recorded, simulator, None).open_loop["source"]
    return {"given": found["source"].overall, "plain": plain.overall, "names": found["model"].overall}


def main(robot: str, run: Path, model: str, given: Path, kept: Path | None = None) -> None:
    """Write the rows of one run to robots.csv beside this file, in the place of former ones of that run.

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


if __name__ == "__main__":
    tyro.cli(main)
