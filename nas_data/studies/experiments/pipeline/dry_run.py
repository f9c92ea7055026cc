"""Jobs of an experiment before it runs."""

from collections.abc import Sequence

from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task_file
from nas_data.policies.dry_run import EVALUATION, POLICY_STEP, plan_policy
from nas_data.policies.policy import read_result
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.runs.stages import read_done
from nas_data.studies.experiments.base import Request
from nas_data.studies.experiments.pipeline.artifacts import METHODS, NAMES, PHI, PHI_NAMED, PSI, list_needed_stages
from nas_data.studies.experiments.pipeline.sequence import NEEDS
from nas_data.studies.experiments.pipeline.stages import list_stages
from nas_data.studies.rough_times import NAMING, RECORDING, estimate_training


def plan_material(request: Request, needs: Sequence[str]) -> list[PlannedJob]:
    """Return the stages that build the artifacts of every environment as planned jobs."""
    jobs = []
    for environment in request.environments:
        folder = request.home(environment) / request.purpose
        for stage in list_stages(needs):
            done = read_done(stage, folder)
            rough = {
                "record": RECORDING,
                NAMES: NAMING,
                PHI: estimate_training(request.sizes.phi(environment)),
                PHI_NAMED: estimate_training(request.sizes.phi(environment)),
                PSI: estimate_training(request.sizes.forward),
            }[stage.name]
            title = f"{make_environment_name(find_task_file(environment))}: {stage.title[0].lower()}{stage.title[1:]}"
            jobs.append(PlannedJob(title, stage.name, rough, done.seconds if done else None))
    return jobs


def plan_sequence(request: Request) -> list[PlannedJob]:
    """Return the jobs of an experiment that predicts held-out episodes with φ and ψ."""
    return plan_material(request, NEEDS)


def plan_policies(request: Request, methods: Sequence[str]) -> list[PlannedJob]:
    """Return the policies of every environment, method and seed as planned jobs."""
    sizes = request.sizes
    return [
        plan_policy(
            f"{make_environment_name(find_task_file(environment))}: policy {method}, seed {seed}",
            sizes.frames,
            sizes.judged,
            request.home(environment) / "policies" / sizes.policies / method / f"seed{seed}",
        )
        for environment in request.environments
        for seed in sizes.seeds
        for method in methods
    ]


def plan_methods(request: Request) -> list[PlannedJob]:
    """Return the jobs of a comparison of methods: artifacts, then policies."""
    methods = request.methods or tuple(METHODS)
    return [*plan_material(request, sorted(list_needed_stages(methods))), *plan_policies(request, methods)]


def plan_count(request: Request, count: int, seed: int, methods: Sequence[str]) -> PlannedJob:
    """Return a number of trajectories and a seed of figure 6 as a planned job."""
    (environment,) = request.environments
    folder = request.home(environment) / request.purpose / "sweep" / str(count) / f"seed{seed}"
    sizes, took, rough = request.sizes, 0.0, 0.0
    for method in methods:
        result = read_result(folder / method / sizes.policies)
        took += result.wall_seconds + result.judging.wall_seconds if result else float("nan")
        learning = NAMING if method.startswith("named") else estimate_training(sizes.phi(environment))
        rough += learning + sizes.frames * POLICY_STEP + sizes.judged * EVALUATION
    return PlannedJob(f"{count} trajectories, seed {seed}", "count", rough, took if took == took else None)
