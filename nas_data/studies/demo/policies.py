"""Fourth stage of the demo: policies are trained on the target, the source, and the learned or named models."""

import json
from pathlib import Path

import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD, Study, compare
from nas_data.policies.evaluate import score_baselines
from nas_data.policies.hyperparameters import Hyperparameters
from nas_data.policies.intervals import describe_bootstrap
from nas_data.policies.training_progress import report_training_progress
from nas_data.runs.parallel import count_cores
from nas_data.runs.stages import INDENT, StageResult
from nas_data.studies.demo.learning import FOLDERS
from nas_data.studies.demo.naming import read_named_dynamics
from nas_data.studies.demo.plan import Demo

FOLDER = "policies"
BASELINES = "policies/baselines.json"


def learn_policies(demo: Demo) -> StageResult:
    """Train every method with every seed, and evaluate each policy on the target."""
    plan = demo.plan
    study = make_study(demo)
    with report_training_progress(study, demo.folder / FOLDER, lambda line: demo.report(f"{INDENT}{line}")):
        comparison = compare(study, demo.folder / FOLDER, count_cores(), lambda line: demo.report(f"{INDENT}{line}"))
    baselines = score_baselines(plan.target, plan.judged)
    said = [
        f"On the target, {plan.judged} episodes a policy (higher is better):",
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
    return StageResult(said, {**comparison.describe(), "baselines": scores}, summary)


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
