"""Table 1: quartiles and mean of squared trajectory differences, on trajectories that no model has seen."""

from collections.abc import Sequence as List

import numpy as np

from nas_data.count_of import count_of
from nas_data.envs.base import find_task_file
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request, ResultTable
from nas_data.studies.experiments.pipeline.authors import DIFFERENCES
from nas_data.studies.experiments.pipeline.dry_run import plan_sequence
from nas_data.studies.experiments.pipeline.sequence import Sequence, predict_heldout
from nas_data.studies.experiments.pipeline.stages import describe_stages
from nas_data.studies.experiments.pipeline.table_notes import list_model_notes

UNIT = np.pi / 2  # [rad] the authors measure angles in units of 90°
PREDICTORS = ("source", "ψ", "source + φ", "hold")
HEADERS = ("predictor", "1st quartile", "mean", "3rd quartile", "median", "authors: Q1, mean, Q3")


def run(request: Request) -> ExperimentResult:
    """Compare predicted with measured trajectories on every environment."""
    tables, notes, data = [], [], {}
    for environment in request.environments:
        found = predict_heldout(request, environment)
        protocol, everything = found.material.paper_protocol(), list(range(found.dataset.n_episodes))
        kinds = {"paper_protocol": (protocol, "the paper's protocol"), "all_heldout": (everything, "all held out")}
        for episodes, name in kinds.values():
            title = (
                f"{environment}, {request.target_text}, {name}: mean over a trajectory of squared differences of one "
                f"joint, angles in units of 90°; {count_of(len(episodes), 'trajectory', plural='trajectories')} × "
                f"{count_of(len(found.dataset.joints), 'joint')}"
            )
            comparable = name == "the paper's protocol" and find_task_file(environment) == "ergo_shield"
            tables.append(
                ResultTable(title, HEADERS, make_rows(found, episodes, comparable), list_model_notes(found.material))
            )
        notes += describe_numbers(found)
        data[environment] = {
            "unit": "squared angle in units of 90 degrees; multiply by (π/2)² for rad²",
            **{
                key: {one: compute_statistics(found, one, chosen) for one in PREDICTORS}
                for key, (chosen, _) in kinds.items()
            },
            "authors": {name: numbers.describe() for name, numbers in DIFFERENCES.items()},
            "dataset": found.material.content_hash,
            "material": found.material.plan.describe(),
            "stages": describe_stages(found.material),
        }
    return ExperimentResult(tables, notes, {"environments": data})


def compute_differences(found: Sequence, name: str, episodes: List[int]) -> np.ndarray:
    """Return the mean squared differences of each trajectory and joint, infinite after divergence, shape (E · n,)."""
    squared = found.evaluation.open_loop[name].squared[list(episodes)] / UNIT**2
    return np.where(np.isfinite(squared), squared, np.inf).ravel()


def compute_statistics(found: Sequence, name: str, episodes: List[int]) -> dict[str, float]:
    """Return quartiles and mean of a predictor's differences; quartiles are actual values, not interpolated."""
    values = compute_differences(found, name, episodes)
    first, middle, third = np.quantile(values, [0.25, 0.5, 0.75], method="inverted_cdf")
    return {"first_quartile": float(first), "mean": float(values.mean()), "third_quartile": float(third)} | {
        "median": float(middle)
    }


def make_rows(found: Sequence, episodes: List[int], authors: bool) -> list[tuple[str, ...]]:
    """Return one table row per predictor."""
    return [
        (
            name,
            *map(format_cell, compute_statistics(found, name, episodes).values()),
            format_authors_numbers(name, authors),
        )
        for name in PREDICTORS
    ]


def format_authors_numbers(name: str, shown: bool) -> str:
    """Return the authors' numbers for a predictor, if published."""
    if not shown or name not in DIFFERENCES:
        return ""
    return ", ".join(f"{value:.3f}" for value in DIFFERENCES[name].values)


def format_cell(value: float) -> str:
    """Return a difference as text."""
    return f"{value:.4f}" if np.isfinite(value) else "diverged"


def describe_numbers(found: Sequence) -> list[str]:
    """Return notes on the data and on diverged trajectories."""
    lost = [
        f"{name} diverged in {count_of(len(times), 'episode')}." for name, times in found.evaluation.diverged.items()
    ]
    return [
        "Every rollout starts once, at the first measured state of a trajectory that was not used to train φ or ψ. The "
        "authors' rollouts are of the real arm, on the file that their models were trained on.",
        *lost,
    ]


EXPERIMENT = Experiment(
    "Quartiles and mean of squared trajectory differences", ("ErgoShield",), run, plan=plan_sequence
)
