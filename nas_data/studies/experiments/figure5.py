"""Figure 5: return of each method's policies on the target."""

from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task_file
from nas_data.reports.figures import draw_returns_by_method
from nas_data.reports.style import to_png
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request
from nas_data.studies.experiments.pipeline.authors import list_remarks
from nas_data.studies.experiments.pipeline.compare_methods import compare_methods, describe, make_panel, make_table
from nas_data.studies.experiments.pipeline.dry_run import plan_methods


def run(request: Request) -> ExperimentResult:
    """Compare the methods on every environment."""
    tables, panels, data = [], [], {}
    for environment in request.environments:
        material, comparison = compare_methods(request, environment)
        name = make_environment_name(find_task_file(environment))
        frames, judged = comparison.study.frames, comparison.study.episodes
        title = f"{name}, {request.target_text}: return on the target, {frames:,} frames, {judged} episodes per policy"
        tables.append(make_table(material, comparison, title))
        panels.append(make_panel(comparison, name))
        data[name] = describe(material, comparison)
    picture = to_png(draw_returns_by_method(panels, "mean return on the target", request.sizes.quick))
    return ExperimentResult(tables, list_remarks(request.environments), {"environments": data}, {"": picture})


EXPERIMENT = Experiment(
    "Return of the policies of each method on the target", ("Pusher", "Striker", "ErgoReacher"), run, plan=plan_methods
)
