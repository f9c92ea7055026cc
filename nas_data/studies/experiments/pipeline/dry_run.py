"""Jobs of an experiment before it runs."""

import json
from collections.abc import Sequence
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task_file
from nas_data.models.run import HISTORY
from nas_data.policies.compare import list_runs, read_finished
from nas_data.policies.dry_run import EVALUATION, POLICY_STEP, plan_policy
from nas_data.policies.policy import read_result
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.runs.stages import Work, list_missing, read_stage
from nas_data.studies.experiments.base import Request
from nas_data.studies.experiments.pipeline.artifacts import (
    METHODS,
    NAMES,
    PHI,
    PHI_NAMED,
    PSI,
    Artifacts,
    MaterialPlan,
    list_needed_stages,
)
from nas_data.studies.experiments.pipeline.compare_methods import find_policies_folder, make_study
from nas_data.studies.experiments.pipeline.learning import read_record
from nas_data.studies.experiments.pipeline.sequence import NEEDS
from nas_data.studies.experiments.pipeline.stages import FOLDER, list_stages
from nas_data.studies.rough_times import NAMING, RECORDING, estimate_training
from nas_data.visible_files import list_visible_files


def plan_material(request: Request, needs: Sequence[str]) -> list[PlannedJob]:
    """Return the stages that build the artifacts of every environment as planned jobs.

    Raises:
        OutputExists: a folder holds something else, or artifacts of another plan or other code.
    """
    jobs = []
    for environment in request.environments:
        plan, stages = request.plan_material(environment), list_stages(needs)
        work = Work(plan, request.home(environment) / request.purpose, request.report, FOLDER)
        missing = list_missing(stages, work)
        for stage in stages:
            title = f"{make_environment_name(find_task_file(environment))}: {stage.title[0].lower()}{stage.title[1:]}"
            took = None if stage.name in missing else read_stage(stage.name, work.folder).seconds
            jobs.append(PlannedJob(title, stage.name, estimate_stage(stage.name, plan), took))
    return jobs


def estimate_stage(name: str, plan: MaterialPlan) -> float:
    """Return the rough time of a stage [s]."""
    if name in {PHI, PHI_NAMED, PSI}:
        frames = plan.recipe.episodes * plan.recipe.steps
        return estimate_training(plan.forward if name == PSI else plan.delta, frames)
    return NAMING if name == NAMES else RECORDING


def plan_sequence(request: Request) -> list[PlannedJob]:
    """Return the jobs of an experiment that predicts held-out episodes with φ and ψ."""
    return plan_material(request, NEEDS)


def plan_policies(request: Request, methods: Sequence[str]) -> list[PlannedJob]:
    """Return the policies of every environment, method and seed as planned jobs.

    Policies of methods whose artifacts are complete are checked against their folders.

    Raises:
        OutputExists: a folder holds another training, or one of other code.
    """
    jobs = []
    for environment in request.environments:
        plan, folder = request.plan_material(environment), find_policies_folder(request, environment)
        work = Work(plan, request.home(environment) / request.purpose, request.report, FOLDER)
        missing = list_missing(list_stages(sorted(list_needed_stages(methods))), work).keys()
        ready = [method for method in methods if not missing & METHODS[method].needs]
        runs = list_runs(make_study(request, Artifacts(plan, work.folder), ready), folder) if ready else []
        policies = [(run.method, run.training.seed, read_finished(run)) for run in runs]
        policies += [(method, seed, None) for seed in request.sizes.seeds for method in methods if method not in ready]
        prefix = f"{make_environment_name(find_task_file(environment))}: policy"
        for method, seed, result in policies:
            name = f"{prefix} {method}, seed {seed}"
            jobs.append(plan_policy(name, request.sizes.frames, request.sizes.judged, result))
    return jobs


def plan_methods(request: Request) -> list[PlannedJob]:
    """Return the jobs of a comparison of methods: artifacts, then policies."""
    methods = request.methods or tuple(METHODS)
    return [*plan_material(request, sorted(list_needed_stages(methods))), *plan_policies(request, methods)]


def plan_count(request: Request, count: int, seed: int, methods: Sequence[str]) -> PlannedJob:
    """Return a number of trajectories and a seed of figure 6 as a planned job."""
    (environment,) = request.environments
    folder = request.home(environment) / request.purpose / "sweep" / str(count) / f"seed{seed}"
    sizes, plan = request.sizes, request.plan_material(environment)
    learning = estimate_training(plan.delta, count * plan.recipe.steps)
    rough = sum(NAMING if method.startswith("named") else learning for method in methods)
    rough += len(methods) * (sizes.frames * POLICY_STEP + sizes.judged * EVALUATION)
    results = [read_result(folder / method / sizes.policies) for method in methods]
    done = [result.wall_seconds + result.judging.wall_seconds for result in results if result]
    took = sum(done) + read_learning_seconds(folder) if len(done) == len(methods) else None
    return PlannedJob(f"{count_of(count, 'trajectory', plural='trajectories')}, seed {seed}", "count", rough, took)


def read_learning_seconds(folder: Path) -> float:
    """Return the time that models and names of a subset took [s]."""
    histories = [json.loads(file.read_text(encoding="utf-8")) for file in list_visible_files(folder, f"*/{HISTORY}")]
    named = read_record(folder / f"{NAMES}.json").get("seconds", 0.0)
    return float(sum(rows[-1]["seconds"] for rows in histories) + named)
