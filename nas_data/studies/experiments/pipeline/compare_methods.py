"""The methods of figure 5, and the comparison of their policies on the target."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from nas_data.envs.base import find_task_file
from nas_data.policies.compare import Comparison, Study, compare, report_training_progress
from nas_data.policies.intervals import compute_median_interval, describe_interval, format_median, format_share_heading
from nas_data.policies.policy import Hyperparameters
from nas_data.reports.figures import Panel
from nas_data.runs.stages import INDENT
from nas_data.studies.experiments.base import Request, ResultTable
from nas_data.studies.experiments.pipeline.artifacts import METHODS, Artifacts, list_needed_stages, make_target
from nas_data.studies.experiments.pipeline.authors import RETURNS
from nas_data.studies.experiments.pipeline.sizes import Sizes
from nas_data.studies.experiments.pipeline.stages import describe_stages
from nas_data.studies.experiments.pipeline.table_notes import describe_paired, describe_target, list_notes
from nas_data.typed_json import to_json


def make_headers(seeds: int) -> tuple[str, ...]:
    """Return the column headings, with the kind of intervals over seeds."""
    several = seeds > 1
    return (
        "method",
        "learned on",
        "seeds",
        f"median [{describe_interval(seeds)}]" if several else "median",
        "mean",
        "min … max",
        "success",
        format_share_heading(seeds),
        "authors: median",
        "authors: mean",
    )


def make_hyperparameters(sizes: Sizes) -> Hyperparameters:
    """Return the hyperparameters of PPO."""
    return Hyperparameters(arms=sizes.arms, rollout=sizes.rollout, minibatches=sizes.minibatches, epochs=sizes.epochs)


def compare_methods(request: Request, environment: str) -> tuple[Artifacts, Comparison]:
    """Train every method with every seed, and evaluate all on the target; methods without artifacts come first."""
    names = request.methods or tuple(METHODS)
    needs = sorted(list_needed_stages(names))
    bare = tuple(name for name in names if not METHODS[name].needs)
    if bare:
        material = request.material(environment, ())
        comparison = run_study(make_study(request, material, bare), request, environment)
        advantage = comparison.compute_advantage()
        if advantage is not None and (sentence := advantage.sentence()):
            request.report(f"{INDENT}{sentence}")
        if not needs:
            return material, comparison
    material = request.material(environment, needs)
    return material, run_study(make_study(request, material, names, material.content_hash), request, environment)


def make_study(request: Request, material: Artifacts, names: Sequence[str], dataset: str | None = None) -> Study:
    """Return the comparison of methods with an environment's artifacts."""
    sizes = request.sizes
    return Study(
        target=make_target(material),
        methods={name: METHODS[name].plant(material) for name in names},
        seeds=sizes.seeds,
        frames=sizes.frames,
        episodes=sizes.judged,
        hyperparameters=make_hyperparameters(sizes),
        dataset=dataset,
    )


def find_policies_folder(request: Request, environment: str) -> Path:
    """Return the folder of the policies of an environment, of the request's lengths and PPO settings."""
    return request.home(environment) / "policies" / request.sizes.policies


def run_study(study: Study, request: Request, environment: str) -> Comparison:
    """Run a comparison in the environment's folder; other lengths and PPO settings have other subfolders."""
    folder = find_policies_folder(request, environment)

    def report(line: str) -> None:
        request.report(f"{INDENT}{line}")

    with report_training_progress(study, folder, report):
        return compare(study, folder, request.workers, report, quiet=True)


def make_table(material: Artifacts, comparison: Comparison, title: str) -> ResultTable:
    """Return the comparison as a table, with the authors' numbers next to ours."""
    rows = [make_row(comparison, material.plan.recipe.environment, method) for method in comparison.study.methods]
    return ResultTable(title, make_headers(len(comparison.study.seeds)), rows, list_notes(material, comparison))


def make_panel(comparison: Comparison, environment: str) -> Panel:
    """Return the returns on an environment for the figure, with the authors' numbers next to ours."""
    returns = {method: comparison.values(method) for method in comparison.study.methods}
    intervals = {method: compute_median_interval(values) for method, values in returns.items()}
    authors = RETURNS.get(find_task_file(environment), {})
    return Panel(environment, returns, intervals, {method: numbers.values for method, numbers in authors.items()})


def make_row(comparison: Comparison, environment: str, method: str) -> Sequence[str]:
    """Return one method's row."""
    returns, closed = comparison.values(method), comparison.share_closed(method)
    authors = RETURNS.get(find_task_file(environment), {}).get(method)
    return (
        method,
        METHODS[method].learned_on,
        str(len(returns)),
        format_median(returns),
        f"{returns.mean():.2f}",
        f"{returns.min():.2f} … {returns.max():.2f}",
        f"{np.median(comparison.values(method, 'success_rate')):.0%}",
        "" if closed is None else str(closed),
        "" if authors is None else f"{authors.median:.2f}",
        "" if authors is None else f"{authors.mean:.2f}",
    )


def describe(material: Artifacts, comparison: Comparison) -> dict[str, object]:
    """Return the comparison for JSON."""
    plan, methods = material.plan, comparison.study.methods
    authors = RETURNS.get(find_task_file(plan.recipe.environment), {})
    runs = [
        {
            "method": method,
            "seed": seed,
            "result": f"{comparison.policy_folder(method, seed).relative_to(comparison.folder)}/result.json",
            **{key: to_json(getattr(result, key)) for key in ("wall_seconds", "cpu_seconds", "judging", "diverged")},
        }
        for (method, seed), result in sorted(comparison.results.items(), key=lambda pair: pair[0])
    ]
    return {
        **comparison.describe(),
        "intervals": {method: compute_median_interval(comparison.values(method)).describe() for method in methods},
        "named_nas_minus_nas": describe_paired(comparison),
        "authors": {method: numbers.describe() for method, numbers in authors.items()},
        "hyperparameters": asdict(comparison.study.hyperparameters),
        "dynamics": describe_target(material),
        "dataset": comparison.study.dataset,
        "material": plan.describe(),
        "stages": describe_stages(material),
        "policies": str(comparison.folder),
        "runs": runs,
    }
