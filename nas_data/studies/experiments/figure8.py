"""Figure 8: hits of each method's policies in ten seconds, and how one joint follows its command."""

from dataclasses import replace

from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task_file
from nas_data.reports.figures import draw_returns_by_method
from nas_data.reports.style import to_png
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request
from nas_data.studies.experiments.pipeline.artifacts import METHODS, NAMES, list_needed_stages
from nas_data.studies.experiments.pipeline.authors import list_remarks
from nas_data.studies.experiments.pipeline.compare_methods import (
    compare_methods,
    describe,
    make_panel,
    make_table,
)
from nas_data.studies.experiments.pipeline.dry_run import plan_material, plan_policies
from nas_data.studies.experiments.pipeline.sequence import NEEDS, predict_heldout

SKIPPED = (
    "What `nas gap` names is left out: naming effects in six joints takes longer than all other stages; "
    "--methods includes it."
)


def run(request: Request) -> ExperimentResult:
    """Draw one joint's response, then compare the methods' hits."""
    notes = list_remarks(request.environments)
    tables, panels, data, pictures = [], [], {}, {}
    if request != (request := choose_methods(request)):
        notes.append(SKIPPED)
    for number, environment in enumerate(request.environments):
        name = make_environment_name(find_task_file(environment))
        found = predict_heldout(request, environment)
        pictures["-response" + (f"-{name}" if number else "")] = found.picture(request.sizes.quick)
        joint, episode = found.dataset.joints[found.joint], found.episode
        notes.append(f"{name}: the response is that of {joint} in held-out episode {episode}, predicted in open loop.")
        material, comparison = compare_methods(request, environment)
        frames = comparison.study.frames
        title = f"{name}, {request.target_text}: mean return of an episode on the target, {frames:,} frames"
        tables.append(make_table(material, comparison, title))
        panels.append(make_panel(comparison, name))
        data[name] = {**describe(material, comparison), "response": found.describe()}
    picture = to_png(draw_returns_by_method(panels, "mean return of an episode", request.sizes.quick))
    return ExperimentResult(tables, notes, {"environments": data}, {"": picture, **pictures})


def choose_methods(request: Request) -> Request:
    """Return the request without the methods that need names, if it is a quick one that gives none."""
    if not request.sizes.quick or request.methods:
        return request
    return replace(request, methods=tuple(name for name, one in METHODS.items() if NAMES not in one.needs))


def plan(request: Request) -> list[PlannedJob]:
    """Return the jobs: artifacts for the response and for the methods, then policies."""
    chosen = choose_methods(request)
    needs = sorted({*NEEDS, *list_needed_stages(chosen.methods or tuple(METHODS))})
    return [*plan_material(chosen, needs), *plan_policies(chosen, chosen.methods or tuple(METHODS))]


EXPERIMENT = Experiment("Hits of each method's policies, and one joint's response", ("ErgoShield",), run, plan=plan)
