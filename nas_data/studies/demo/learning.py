"""The demo's third stage: φ and ψ learn side by side, and are compared with the names on fresh episodes."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from safetensors.numpy import load_file, save

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.metrics import Errors
from nas_data.models.evaluation import MODEL, Evaluation, evaluate
from nas_data.models.lstm import Kind
from nas_data.models.presets import TrainingOptions
from nas_data.runs.parallel import run_jobs
from nas_data.runs.progress import Report, say
from nas_data.runs.stages import INDENT, StageResult
from nas_data.sources import find_source
from nas_data.studies.demo.naming import named_dynamics
from nas_data.studies.demo.plan import Demo
from nas_data.studies.demo.recording import HELDOUT, TRAIN, newest
from nas_data.studies.experiments.pipeline.learning import ModelJob, train_model
from nas_data.studies.experiments.pipeline.trajectories import PREDICTORS, compare_models
from nas_data.whole_file import write_whole

FOLDERS: dict[Kind, str] = {"delta": "models/phi", "forward": "models/psi"}
ROLLOUTS = "models/rollouts.safetensors"
ERRORS = "models/errors.json"
NAMES = "source + names"
SHOWN = (*MODEL.values(), NAMES, *PREDICTORS[len(MODEL) :])  # in the order of tables

Kept = TypeVar("Kept")
ErrorTable = dict[str, dict[str, float]]
"""RMSE [rad] by predictor, then by joint; `all` is over all joints."""


def learn(job: ModelJob) -> list[dict[str, float]]:
    """Train one of the two models, and say which it is."""
    return train_model(job, reporter("φ" if job.kind == "delta" else "ψ"))


def reporter(name: str) -> Report:
    """Return a report that says which of the two models, trained side by side, a line is about."""
    return lambda line: say(f"{INDENT}{name}  {line}")


def learn_models(demo: Demo) -> StageResult:
    """Train both models and compare them, and the source with the names, on the held-out episodes."""
    train, heldout = newest(demo, TRAIN), newest(demo, HELDOUT)
    options: dict[Kind, TrainingOptions] = {"delta": demo.plan.delta, "forward": demo.plan.forward}
    threads = 1 if cores() > 1 else None  # side by side, a core each
    jobs = [ModelJob(kind, train, options[kind], demo.folder / FOLDERS[kind], threads) for kind in FOLDERS]
    histories = {jobs[number].kind: rows for number, rows in run_jobs(learn, jobs, cores())}
    dataset = read(heldout)
    delta, psi = (demo.folder / FOLDERS[kind] for kind in FOLDERS)
    evaluation = compare_models(dataset, find_source(None, (), dataset, [heldout]), delta, psi)
    if (named := named_dynamics(demo)) is not None:
        evaluation = with_names(evaluation, evaluate(dataset, named.simulator(), None))
    save_rollouts(evaluation, dataset, demo.folder / ROLLOUTS)
    errors = {"one_step": table_of(evaluation.one_step), "open_loop": table_of(evaluation.open_loop)}
    write_whole(demo.folder / ERRORS, (json.dumps(errors, indent=1) + "\n").encode())
    said = [
        f"On {dataset.n_episodes} held-out episodes, what was learned and named above what needs neither:",
        *evaluation.text().splitlines(),
        f"φ → {demo.folder / FOLDERS['delta']}, ψ → {demo.folder / FOLDERS['forward']}",
    ]
    overall = {name: np.degrees(one.overall) for name, one in evaluation.open_loop.items()}
    summary = [
        "Open-loop error of positions on held-out episodes: "
        + ", ".join(f"{name} {error:.2f}°" for name, error in overall.items())
    ]
    return StageResult(said, {"histories": {MODEL[kind]: histories[kind] for kind in FOLDERS}, **errors}, summary)


def with_names(evaluation: Evaluation, named: Evaluation) -> Evaluation:
    """Return an evaluation with the source that has the names beside the others.

    Args:
        evaluation: Of φ, ψ and what needs no learning.
        named: Of the source with the names, on the same episodes.
    """

    def merge(others: Mapping[str, Kept], own: Mapping[str, Kept]) -> dict[str, Kept]:
        both = {**others, NAMES: own["source"]}
        return {name: both[name] for name in SHOWN if name in both}

    left = {NAMES: named.diverged["source"]} if "source" in named.diverged else {}
    return Evaluation(
        merge(evaluation.one_step, named.one_step),
        merge(evaluation.open_loop, named.open_loop),
        merge(evaluation.rollouts, named.rollouts),
        {**evaluation.diverged, **left},
    )


def table_of(errors: Mapping[str, Errors]) -> ErrorTable:
    """Return errors [rad] by joint and over all joints, by predictor."""
    return {name: {**one.per_joint, "all": one.overall} for name, one in errors.items()}


def load_errors(path: Path) -> dict[str, ErrorTable]:
    """Return the errors of one step and in open loop that the stage kept."""
    errors: dict[str, ErrorTable] = json.loads(path.read_text(encoding="utf-8"))
    return errors


def save_rollouts(evaluation: Evaluation, dataset: Dataset, path: Path) -> None:
    """Keep the positions [rad] of every open-loop rollout for the pictures, each predictor's of shape (E, T, n)."""
    n = len(dataset.joints)
    rows = list(dataset.episodes())
    curves = {"measured": [dataset.next_states[row] for row in rows], **evaluation.rollouts}
    stacked = {name: np.stack([episode[:, :n] for episode in episodes]) for name, episodes in curves.items()}
    write_whole(path, save({name: np.ascontiguousarray(values, dtype=np.float32) for name, values in stacked.items()}))


def load_rollouts(path: Path) -> dict[str, np.ndarray]:
    """Return positions [rad] of shape (E, T, n): measured, and by predictor in the order of tables."""
    kept = load_file(path)
    return {name: kept[name] for name in ("measured", *SHOWN) if name in kept}


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))
