"""Figure 6: policy return against the number of recorded trajectories for φ, ψ and named effects."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from nas_data.count_of import count_of
from nas_data.envs.base import find_task_file
from nas_data.errors import OptionError
from nas_data.models.symmetry import find_symmetry
from nas_data.models.training import check_torques
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD, Comparison
from nas_data.policies.evaluate import summarise_spread
from nas_data.policies.intervals import describe_interval, format_median
from nas_data.reports.figures import draw_return_over_count
from nas_data.reports.style import to_png
from nas_data.runs.job_locks import list_locks
from nas_data.runs.parallel import run_jobs
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.runs.progress import format_duration
from nas_data.runs.stages import INDENT
from nas_data.studies.ablation.summary import MAX_EXCESS
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request, ResultTable
from nas_data.studies.experiments.pipeline.artifacts import Artifacts
from nas_data.studies.experiments.pipeline.authors import RETURN_BY_COUNT
from nas_data.studies.experiments.pipeline.compare_methods import make_hyperparameters, make_study, run_study
from nas_data.studies.experiments.pipeline.dry_run import plan_count, plan_material, plan_policies
from nas_data.studies.experiments.pipeline.sample_size import BY_PRESET, LEARNED, LEARNED_ON, CountJob, do_count
from nas_data.studies.experiments.pipeline.stages import describe_stages
from nas_data.studies.experiments.pipeline.table_notes import NAS, describe_intervals, describe_target
from nas_data.typed_json import to_json

ENDS = (EXPERT_METHOD, SOURCE_METHOD)  # lower and upper reference of the curves
ONE_RECORDING = "One recording (of seed 0) serves all seeds; each seed has its own subset, models and policy."


def run(request: Request) -> ExperimentResult:
    """Sweep the number of trajectories on one environment."""
    counts, methods = choose_counts(request)
    (environment,) = request.environments
    recording = choose_recording(request, counts)
    ends = run_study(make_study(request, recording.material(environment, ()), ENDS), request, environment)
    material = recording.material(environment, ("record",))
    returns, runs = sweep(request, material, counts, methods)
    authors = RETURN_BY_COUNT if find_task_file(environment) == "pusher" and NAS in methods else {}
    picture = draw_return_over_count(
        counts,
        returns,
        {method: LEARNED_ON[method] for method in methods},
        {method: float(np.median(ends.values(method))) for method in ENDS},
        authors,
        request.sizes.quick,
    )
    return ExperimentResult(
        [make_table(request, material, counts, returns, ends)],
        [describe_sufficient_count(method, counts, values) for method, values in returns.items()],
        {
            "environment": environment,
            "counts": list(counts),
            "seeds": list(request.sizes.seeds),
            "methods": {method: describe(counts, values) for method, values in returns.items()},
            "runs": runs,
            "ends": ends.describe(),
            "authors": {str(count): {"mean": pair[0], "sd": pair[1]} for count, pair in authors.items()},
            "hyperparameters": asdict(make_hyperparameters(request.sizes)),
            "dynamics": describe_target(material),
            "stages": describe_stages(material),
            "dataset": material.content_hash,
            "material": material.plan.describe(),
        },
        {"": to_png(picture)},
    )


def choose_recording(request: Request, counts: tuple[int, ...]) -> Request:
    """Return the request with one recording for all numbers of trajectories."""
    recorded = request.sizes.trajectories or max(counts)
    return replace(request, sizes=replace(request.sizes, trajectories=recorded), purpose=f"counts{recorded}")


def plan(request: Request) -> list[PlannedJob]:
    """Return the jobs: the recording, the policies of both references, and every count and seed."""
    counts, methods = choose_counts(request)
    recording = choose_recording(request, counts)
    every = [plan_count(recording, count, seed, methods) for seed in request.sizes.seeds for count in counts]
    return [*plan_material(recording, ("record",)), *plan_policies(request, ENDS), *every]


def choose_counts(request: Request) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the numbers of trajectories and the methods, before any work is done.

    Raises:
        OptionError: there are too few trajectories to learn from, or the arm cannot be trained by a method's preset.
    """
    counts, methods = tuple(sorted(set(request.sizes.counts))), tuple(dict.fromkeys(request.methods or (NAS,)))
    if min(counts) < 2:
        raise OptionError(
            f"--counts has {counts[0]}; give at least 2 trajectories, because one of them is held out for validation."
        )
    check_presets(request, methods)
    return counts, methods


def check_presets(request: Request, methods: Sequence[str]) -> None:
    """Refuse methods whose preset cannot be trained on the environment.

    Raises:
        OptionError: a preset corrects torques, where the arm takes none or its model has no symmetry.
        ModelFileError: the symmetry that the model declares does not hold.
    """
    (environment,) = request.environments
    plan = request.plan_material(environment)
    for method in filter(BY_PRESET.get, methods):
        options = request.sizes.presets[BY_PRESET[method]]
        if options.corrects != "command":
            continue
        simulator = plan.task.simulator(plan.source)
        try:
            check_torques("delta", simulator.kinds, options, simulator)
            if options.symmetric:
                find_symmetry(simulator)
        except OptionError as error:
            raise OptionError(
                f"{method} cannot be trained on {environment}: {error} That is the method nas_few."
            ) from None


def describe(counts: tuple[int, ...], returns: np.ndarray) -> dict[str, object]:
    """Return one method's results for JSON; returns have shape (counts, seeds)."""
    return {
        "returns": returns.tolist(),
        "spread": {str(count): summarise_spread(values) for count, values in zip(counts, returns, strict=True)},
        "enough": find_sufficient_count(counts, returns) if len(counts) > 1 else None,
    }


def sweep(
    request: Request, material: Artifacts, counts: tuple[int, ...], methods: tuple[str, ...]
) -> tuple[Mapping[str, np.ndarray], list[dict[str, object]]]:
    """Run every count and seed; large counts run last.

    Returns:
        Returns on the target by method, shape (counts, seeds), and the time of each.
    """
    sizes = request.sizes
    jobs = [
        CountJob(
            material=material,
            methods=methods,
            count=count,
            seed=seed,
            frames=sizes.frames,
            episodes=sizes.judged,
            hyperparameters=make_hyperparameters(sizes),
            policies=sizes.policies,
            folder=material.folder / "sweep" / str(count) / f"seed{seed}",
            presets=sizes.presets,
            threads=1 if request.workers.one_core else None,
        )
        for seed in sizes.seeds
        for count in counts
    ]
    returns = {method: np.full((len(counts), len(sizes.seeds)), np.nan) for method in methods}
    runs: list[dict[str, object]] = []
    began = time.monotonic()
    locks = list_locks(material.folder / "sweep", [f"{job.count}/seed{job.seed}" for job in jobs])
    for done, (index, results) in enumerate(run_jobs(do_count, jobs, request.workers, locks=locks), start=1):
        job = jobs[index]
        for method, (result, seconds) in results.items():
            returns[method][counts.index(job.count), sizes.seeds.index(job.seed)] = result.score.mean_return
            took = {key: to_json(getattr(result, key)) for key in ("wall_seconds", "cpu_seconds", "judging")}
            identity = {"method": method, "count": job.count, "seed": job.seed}
            runs.append({**identity, "learning_seconds": seconds, **took})
        left = (time.monotonic() - began) / done * (len(jobs) - done)
        reached = ", ".join(f"{method} {result.score.mean_return:.2f}" for method, (result, _) in results.items())
        progress = (
            f"{done} of {len(jobs)}: {count_of(job.count, 'trajectory', plural='trajectories')}, seed {job.seed}: "
            f"return {reached}"
        )
        request.report(f"{INDENT}{progress}, about {format_duration(left)} left")
    return returns, runs


def find_sufficient_count(counts: tuple[int, ...], returns: np.ndarray) -> int:
    """Return the smallest count whose median return is within 5 % of the best median."""
    medians = np.median(returns, axis=1)
    enough = medians >= medians.max() - MAX_EXCESS * abs(medians.max())
    return counts[int(np.argmax(enough))]


def describe_sufficient_count(method: str, counts: tuple[int, ...], returns: np.ndarray) -> str:
    """Describe the sufficient number of trajectories of a method; a single count is not conclusive."""
    medians = np.median(returns, axis=1)
    if len(counts) == 1:
        return (
            f"{LEARNED_ON[method]}: median return {medians[0]:.2f} with "
            f"{count_of(counts[0], 'trajectory', plural='trajectories')}; give several --counts to find how many are "
            "enough."
        )
    best, count = int(np.argmax(medians)), find_sufficient_count(counts, returns)
    text = f"{LEARNED_ON[method]}: smallest number of trajectories whose median return is within "
    text += f"{MAX_EXCESS:.0%} of the best: {count} ({medians[counts.index(count)]:.2f}; best {medians[best]:.2f} with "
    text += f"{counts[best]})"
    return text + (", the largest amount tried; more may help." if count == counts[-1] else ".")


def make_table(
    request: Request,
    material: Artifacts,
    counts: tuple[int, ...],
    returns: Mapping[str, np.ndarray],
    ends: Comparison,
) -> ResultTable:
    """Return the table: each method's counts, then both references."""
    environment, seeds = request.environments[0], len(request.sizes.seeds)
    rows = [
        (LEARNED_ON[method], str(count), *format_cells(row), format_authors_numbers(environment, method, count))
        for method, values in returns.items()
        for count, row in zip(counts, values, strict=True)
    ]
    rows += [(LEARNED_ON[method], "none", *format_cells(ends.values(method)), "") for method in ENDS]
    title = (
        f"{environment}, {request.target_text}: return on the target by recorded trajectories, "
        f"{request.sizes.frames:,} frames, {request.sizes.judged} episodes each"
    )
    advantage = ends.compute_advantage()
    nothing = None if advantage is None else advantage.sentence()
    notes = [
        describe_target(material),
        *([nothing] if nothing else []),
        ONE_RECORDING,
        describe_intervals(seeds),
        *ends.describe_diverged(),
    ]
    return ResultTable(title, make_headers(seeds), rows, [note for note in notes if note])


def make_headers(seeds: int) -> tuple[str, ...]:
    """Return the column headings, with the kind of interval over seeds."""
    median = f"return: median [{describe_interval(seeds)}]" if seeds > 1 else "return: median"
    return ("learned on", "trajectories", "seeds", median, "min … max", "mean ± sd", "authors: mean ± sd")


def format_cells(values: np.ndarray) -> tuple[str, str, str, str]:
    """Return the number of seeds, median with its interval, extremes, mean with its deviation."""
    over = summarise_spread(values)
    return (
        str(len(values)),
        format_median(values),
        f"{values.min():.2f} … {values.max():.2f}",
        f"{over['mean']:.2f} ± {over['sd']:.2f}",
    )


def format_authors_numbers(environment: str, method: str, count: int) -> str:
    """Return the authors' numbers, if published."""
    if method != NAS or find_task_file(environment) != "pusher" or count not in RETURN_BY_COUNT:
        return ""
    mean, deviation = RETURN_BY_COUNT[count]
    return f"{mean:.2f} ± {deviation:.2f}"


EXPERIMENT = Experiment(
    "Return by number of recorded trajectories", ("Pusher",), run, several=False, methods=tuple(LEARNED), plan=plan
)
