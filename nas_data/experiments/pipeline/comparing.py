"""Methods compared on one environment: policies of every method and seed, judged on the target, done once."""

from collections.abc import Sequence

import numpy as np

from nas_data.envs.base import find_task_file
from nas_data.experiments.base import Request, Table
from nas_data.experiments.pipeline.authors import RETURNS
from nas_data.experiments.pipeline.material import Material
from nas_data.experiments.pipeline.methods import METHODS, needs_of, target
from nas_data.experiments.pipeline.sizes import Sizes
from nas_data.policies.compare import Comparison, Study, compare
from nas_data.policies.learner import Hyperparameters
from nas_data.policies.share import LEVEL, resampled_medians
from nas_data.policies.watching import watching
from nas_data.stages import INDENT

HEADERS = (
    "method",
    "learned on",
    "seeds",
    "median [95 %]",
    "min … max",
    "success",
    "distance closed [95 %]",
    "authors",
)


def chosen(request: Request) -> tuple[str, ...]:
    """Return the methods that are compared."""
    return request.methods or tuple(METHODS)


def hyperparameters(sizes: Sizes) -> Hyperparameters:
    """Return PPO's."""
    return Hyperparameters(rollout=sizes.rollout, minibatches=sizes.minibatches, epochs=sizes.epochs)


def compare_methods(request: Request, environment: str) -> tuple[Material, Comparison]:
    """Make the material, train every method with every seed, and judge all on the target."""
    names, sizes = chosen(request), request.sizes
    material = request.material(environment, sorted(needs_of(names)))
    study = Study(
        target=target(material),
        methods={name: METHODS[name].plant(material) for name in names},
        seeds=sizes.seeds,
        frames=sizes.frames,
        episodes=sizes.judged,
        hyperparameters=hyperparameters(sizes),
        dataset=material.content_hash,
    )
    return material, run_study(study, request, environment)


def run_study(study: Study, request: Request, environment: str) -> Comparison:
    """Run a study in the environment's folder, where policies of other lengths lie apart."""
    folder = request.home(environment) / "policies" / str(study.frames)

    def report(line: str) -> None:
        request.report(f"{INDENT}{line}")

    with watching(study, folder, report):
        return compare(study, folder, request.workers, report, quiet=True)


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the median over seeds."""
    low, high = np.quantile(resampled_medians(values, np.random.default_rng(0)), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def median_text(values: np.ndarray) -> str:
    """Return the median over seeds with its interval, which a single seed does not have."""
    if len(values) < 2:
        return f"{np.median(values):.2f}"
    low, high = median_interval(values)
    return f"{np.median(values):.2f} [{low:.2f}, {high:.2f}]"


def table(comparison: Comparison, environment: str, title: str) -> Table:
    """Return the comparison as a table, the authors' means beside ours."""
    rows = [row(comparison, environment, method) for method in comparison.study.methods]
    return Table(title, HEADERS, rows)


def row(comparison: Comparison, environment: str, method: str) -> Sequence[str]:
    """Return one method's row."""
    returns, closed = comparison.values(method), comparison.share_closed(method)
    authors = RETURNS.get(find_task_file(environment), {}).get(method)
    return (
        method,
        METHODS[method].learned_on,
        str(len(returns)),
        median_text(returns),
        f"{returns.min():.2f} … {returns.max():.2f}",
        f"{np.median(comparison.values(method, 'success_rate')):.0%}",
        "" if closed is None else str(closed),
        "" if authors is None else f"{authors.mean:.2f}",
    )


def describe(material: Material, comparison: Comparison, environment: str) -> dict[str, object]:
    """Return the comparison for JSON."""
    authors = RETURNS.get(find_task_file(environment), {})
    described = comparison.describe()
    runs = [
        {
            "method": method,
            "seed": seed,
            "result": f"{comparison.policy_folder(method, seed).relative_to(comparison.folder)}/result.json",
            "wall_seconds": record["wall_seconds"],
            "cpu_seconds": record["cpu_seconds"],
        }
        for (method, seed), record in sorted(comparison.records.items())
    ]
    return {
        **described,
        "interval95": {method: median_interval(comparison.values(method)) for method in comparison.study.methods},
        "authors": {method: numbers.describe() for method, numbers in authors.items()},
        "dataset": material.content_hash,
        "material": material.plan.describe(),
        "policies": str(comparison.folder),
        "runs": runs,
    }
