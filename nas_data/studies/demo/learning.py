"""Third and fourth stage of the demo: train and compare φ and ψ, then policies."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save

from nas_data.atomic_file import write_atomic
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.metrics import Errors
from nas_data.models.evaluation import Evaluation, evaluate
from nas_data.models.lstm import Kind
from nas_data.models.predictions import MODEL
from nas_data.models.presets import TrainingOptions
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD, Study, compare, report_training_progress
from nas_data.policies.evaluate import score_baselines
from nas_data.policies.intervals import describe_bootstrap
from nas_data.policies.policy import Hyperparameters
from nas_data.runs.parallel import Workers, count_cores, run_jobs
from nas_data.runs.progress import say
from nas_data.runs.stages import INDENT, StageResult
from nas_data.sources import find_source
from nas_data.studies.demo.plan import Demo
from nas_data.studies.demo.recording import HELDOUT, TRAIN, find_newest, read_named_dynamics
from nas_data.studies.experiments.pipeline.learning import PREDICTORS, ModelJob, combine, compare_models, train_model

FOLDERS: dict[Kind, str] = {"delta": "models/phi", "forward": "models/psi"}
ROLLOUTS = "models/rollouts.safetensors"
ERRORS = "models/errors.json"
NAMES = "source + names"
SHOWN = (*MODEL.values(), NAMES, *PREDICTORS[len(MODEL) :])  # order in tables

ErrorTable = dict[str, dict[str, float]]
"""RMSE [rad] by predictor, then by joint; `all` is over all joints."""


def learn(job: ModelJob) -> list[dict[str, float]]:
    """Train one of the two models; its name is part of each progress line."""
    name = "φ" if job.kind == "delta" else "ψ"
    return train_model(job, lambda line: say(f"{INDENT}{name}  {line}"))


def learn_models(demo: Demo) -> StageResult:
    """Train both models, and compare them and the source with named effects on the held-out episodes."""
    train, heldout = find_newest(demo, TRAIN), find_newest(demo, HELDOUT)
    options: dict[Kind, TrainingOptions] = {"delta": demo.plan.delta, "forward": demo.plan.forward}
    threads = 1 if count_cores() > 1 else None  # one core for each model
    jobs = [ModelJob(kind, train, options[kind], demo.folder / FOLDERS[kind], threads) for kind in FOLDERS]
    histories = {jobs[number].kind: rows for number, rows in run_jobs(learn, jobs, Workers(count_cores()))}
    dataset = read(heldout)
    delta, psi = (demo.folder / FOLDERS[kind] for kind in FOLDERS)
    evaluation = compare_models(dataset, find_source(None, (), dataset, [heldout]), delta, psi)
    if (named := read_named_dynamics(demo)) is not None:
        evaluation = with_names(evaluation, evaluate(dataset, named.simulator(), None))
    save_rollouts(evaluation, dataset, demo.folder / ROLLOUTS)
    errors = {"one_step": make_error_table(evaluation.one_step), "open_loop": make_error_table(evaluation.open_loop)}
    write_atomic(demo.folder / ERRORS, (json.dumps(errors, indent=1) + "\n").encode())
    texts = [
        f"On {dataset.n_episodes} held-out episodes, learned and named models above the baselines:",
        *evaluation.text().splitlines(),
        f"φ → {demo.folder / FOLDERS['delta']}, ψ → {demo.folder / FOLDERS['forward']}",
    ]
    overall = {name: np.degrees(one.overall) for name, one in evaluation.open_loop.items()}
    summary = [
        "Open-loop error of positions on held-out episodes: "
        + ", ".join(f"{name} {error:.2f}°" for name, error in overall.items())
    ]
    return StageResult(texts, {"histories": {MODEL[kind]: histories[kind] for kind in FOLDERS}, **errors}, summary)


def with_names(evaluation: Evaluation, named: Evaluation) -> Evaluation:
    """Return an evaluation of φ, ψ and baselines with that of the source with named effects on the same episodes."""
    renamed = Evaluation(
        {NAMES: named.one_step["source"]},
        {NAMES: named.open_loop["source"]},
        {NAMES: named.rollouts["source"]},
        {NAMES: named.diverged["source"]} if "source" in named.diverged else {},
    )
    return combine(renamed, evaluation, SHOWN)


def make_error_table(errors: Mapping[str, Errors]) -> ErrorTable:
    """Return errors [rad] by joint and over all joints, by predictor."""
    return {name: {**one.per_joint, "all": one.overall} for name, one in errors.items()}


def load_errors(path: Path) -> dict[str, ErrorTable]:
    """Return the stored one-step and open-loop errors."""
    errors: dict[str, ErrorTable] = json.loads(path.read_text(encoding="utf-8"))
    return errors


def save_rollouts(evaluation: Evaluation, dataset: Dataset, path: Path) -> None:
    """Store the positions [rad] of all open-loop rollouts for the charts, shape (E, T, n) for each predictor."""
    n = len(dataset.joints)
    rows = list(dataset.episodes())
    curves = {"measured": [dataset.next_states[row] for row in rows], **evaluation.rollouts}
    stacked = {name: np.stack([episode[:, :n] for episode in episodes]) for name, episodes in curves.items()}
    write_atomic(path, save({name: np.ascontiguousarray(values, dtype=np.float32) for name, values in stacked.items()}))


def load_rollouts(path: Path) -> dict[str, np.ndarray]:
    """Return the stored positions [rad], shape (E, T, n): measured, then by predictor in the order of tables."""
    kept = load_file(path)
    return {name: kept[name] for name in ("measured", *SHOWN) if name in kept}


FOLDER = "policies"
BASELINES = "policies/baselines.json"


def learn_policies(demo: Demo) -> StageResult:
    """Train every method with every seed, and evaluate each policy on the target."""
    plan = demo.plan
    study = make_study(demo)
    with report_training_progress(study, demo.folder / FOLDER, lambda line: demo.report(f"{INDENT}{line}")):
        comparison = compare(
            study, demo.folder / FOLDER, Workers(count_cores()), lambda line: demo.report(f"{INDENT}{line}")
        )
    baselines = score_baselines(plan.target, plan.judged)
    texts = [
        f"On the target, {plan.judged} episodes per policy (higher is better):",
        *comparison.table().splitlines(),
        *(f"without learning, {name}: return {score.mean_return:.2f}" for name, score in baselines.items()),
        f"policies → {demo.folder / FOLDER}",
    ]
    scores = {name: score.describe() for name, score in baselines.items()}
    write_atomic(demo.folder / BASELINES, (json.dumps(scores, indent=1) + "\n").encode())
    several = len(plan.seeds) > 1
    over = f", median of {len(plan.seeds)} seeds" if several else f", seed {plan.seeds[0]}"
    brackets = f" (in brackets: {describe_bootstrap(len(plan.seeds))})" if several else ""
    summary = [
        f"Return on the target{over}: "
        + ", ".join(f"{method} {np.median(comparison.values(method)):.2f}" for method in study.methods),
        *(
            f"{method} closes {closed} of the distance from source to expert{brackets}"
            for method in study.methods
            if (closed := comparison.share_closed(method)) is not None and not np.isnan(closed.value)
        ),
    ]
    return StageResult(texts, {**comparison.describe(), "baselines": scores}, summary)


def load_baselines(path: Path) -> dict[str, dict[str, float]]:
    """Return the stored scores of untrained baselines."""
    scores: dict[str, dict[str, float]] = json.loads(path.read_text(encoding="utf-8"))
    return scores


def make_study(demo: Demo) -> Study:
    """Return the methods to compare: expert, source, φ, ψ and named effects, if any."""
    plan = demo.plan
    delta, forward = (str(demo.folder / FOLDERS[kind]) for kind in FOLDERS)
    named = read_named_dynamics(demo)
    return Study(
        target=plan.target,
        methods={
            EXPERT_METHOD: plan.target,
            SOURCE_METHOD: plan.source,
            "augmented": DynamicsSpec(plan.environment, checkpoint=delta),
            "forward": DynamicsSpec(plan.environment, checkpoint=forward),
            **({} if named is None else {"named": named}),
        },
        seeds=plan.seeds,
        frames=plan.frames,
        episodes=plan.judged,
        hyperparameters=Hyperparameters(rollout=plan.rollout, minibatches=plan.minibatches, epochs=plan.epochs),
    )
