"""Score models of the XL330 pendulum on logs that none of them was fitted to; the commands are in xl330.md."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import tyro
from pages import write_table

from nas_data.dataset.read import read
from nas_data.dataset.torque_off import keep_torque_on_and_fall
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.versions import resolve
from nas_data.effects.base import Effect, read_effects
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.floor import estimate_noise_floor
from nas_data.gap.gains import with_relative_gains
from nas_data.gap.nominal import Nominal, find_fine_timestep, with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.final import fit_final
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.gap.write_model import read_factors
from nas_data.runs.environment_info import find_commit

HERE = Path(__file__).parent
MODEL, AUTHORS = HERE / "xl330.xml", HERE / "xl330_authors.json"
TRAJECTORIES = ("lift_and_drop", "sin_sin", "up_and_down")


def recorded(dataset: Path) -> tuple[tuple[str, ...], EpisodeBatch]:
    """Return the names of a dataset's logs, and what they measured."""
    root = resolve(dataset)
    transitions, _ = as_transitions(read(root))
    told = with_relative_gains(transitions, MODEL, root)
    return told.tasks, EpisodeBatch.of(keep_torque_on_and_fall(told))


def errors(
    evidence: EpisodeBatch, effects: Sequence[Effect] = (), factors: Mapping[str, float] | None = None
) -> np.ndarray:
    """Return the open-loop RMSE of each log [°] for the frictionless model with effects, shape (E,)."""
    nominal = Nominal.load(MODEL, evidence)
    nominal = with_timestep(nominal, find_fine_timestep(nominal))
    return np.degrees(np.sqrt(evidence.mean_squares(nominal.predict(evidence, effects, factors))[:, 0]))


def refitted(evidence: EpisodeBatch) -> tuple[Sequence[Effect], Mapping[str, float]]:
    """Fit the authors' effects and the model's own numbers to other logs: what their form of friction can foresee."""
    task = FitTask(Nominal.load(MODEL, evidence), evidence, estimate_noise_floor(evidence))
    final = fit_final(task, Description(tuple(read_effects(AUTHORS))), {})
    return final.effects, final.factors


def fit_without_names(dataset: Path) -> tuple[Sequence[Effect], Mapping[str, float]]:
    """Make the plain fit to a dataset, on the episodes that `nas gap` fits."""
    problem = Problem.load(dataset, MODEL)
    plain = fit_plain(Search.begin(problem.train, problem.held))
    return plain.effects, plain.fit.factors


def held_out(trajectory: str, datasets: Path, runs: Path) -> list[dict[str, object]]:
    """Return the table's rows of one trajectory; what is named was fitted on the other two."""
    logs, evidence = recorded(datasets / trajectory)
    others, named = recorded(datasets / f"without_{trajectory}")[1], runs / f"without_{trajectory}" / "effects.json"
    methods = {
        "frictionless": errors(evidence),
        "authors": errors(evidence, read_effects(AUTHORS)),
        "refitted": errors(evidence, *refitted(others)),
        "plain": errors(evidence, *fit_without_names(datasets / f"without_{trajectory}")),
        "named": errors(evidence, read_effects(named), read_factors(named)),
    }
    known = {"experiment": "held-out logs", "seed": "", "commit": (find_commit() or "")[:7], "unit": "deg"}
    return [
        {**known, "method": method, "log": logs[int(number)], "open_loop": round(float(error), 3)}
        for method, found in methods.items()
        for number, error in zip(evidence.numbers, found, strict=True)
    ]


def list_names(runs: Path, trajectory: str) -> list[dict[str, object]]:
    """Return what was named without one trajectory: a row a parameter, with value, interval and confidence."""
    report = json.loads((runs / f"without_{trajectory}" / "report.json").read_text(encoding="utf-8"))
    return [
        {"held_out": trajectory, "effect": entry["effect"], "joint": entry["joint"], "parameter": name}
        | {"value": found["value"], "unit": found["unit"]}
        | dict(zip(("low", "high"), found["interval95"], strict=True))
        | {"confidence": entry["confidence"], "in_model_xml": entry["in_model_xml"]}
        for entry in report["effects"]
        for name, found in entry["parameters"].items()
    ]


def main(datasets: tyro.conf.Positional[Path], runs: tyro.conf.Positional[Path]) -> None:
    """Write xl330.csv and xl330_names.csv beside this file.

    Args:
        datasets: Folder of the logs, as xl330.md imports them.
        runs: Folder of the gap reports that xl330.md's commands wrote.
    """
    write_table(
        HERE / "xl330.csv", [row for trajectory in TRAJECTORIES for row in held_out(trajectory, datasets, runs)]
    )
    write_table(HERE / "xl330_names.csv", [row for trajectory in TRAJECTORIES for row in list_names(runs, trajectory)])


if __name__ == "__main__":
    tyro.cli(main)
