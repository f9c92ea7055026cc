"""Run of an experiment: checks it first, and writes JSON, tables and figures."""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.atomic_file import write_atomic
from nas_data.environment_ids import make_environment_name
from nas_data.envs.base import find_task, find_task_file
from nas_data.errors import OptionError, UnknownName
from nas_data.runs.environment_info import find_commit, read_versions
from nas_data.runs.parallel import combine_errors
from nas_data.runs.planned_jobs import PlannedJob
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request, find_experiment
from nas_data.studies.experiments.pipeline.artifacts import METHODS, check_methods
from nas_data.typed_json import make_finite


@dataclass(frozen=True)
class ExperimentRun:
    """A finished experiment."""

    text: str  # results as text, with the paths of the files
    data: Mapping[str, object]  # values for JSON
    files: tuple[Path, ...]  # written files


def run_experiment(name: str, request: Request) -> ExperimentRun:
    """Run an experiment and write its files, those of single environments as soon as they are done.

    Raises:
        UnknownName: there is no such experiment, environment, dynamics or method; lists the choices.
        OptionError: a size is invalid.
        OutputExists: the folder holds something else, or results of other code.
        JobsFailed: several jobs failed; all others are finished.
    """
    experiment, request = prepare(name, request)
    if len(request.environments) > 1:
        make_each(name, experiment, request)
        request.report("all environments together")
    return make(name, experiment, request)


def list_experiment_jobs(name: str, request: Request) -> list[PlannedJob]:
    """Return the jobs of an experiment, without running any.

    Raises:
        UnknownName: there is no such experiment, environment, dynamics or method; lists the choices.
        OptionError: a size is invalid.
    """
    experiment, request = prepare(name, request)
    return experiment.plan(request)


def prepare(name: str, request: Request) -> tuple[Experiment, Request]:
    """Return an experiment, and its request in usual form; refuse an impossible one.

    Environments have their usual spelling, so that file names do not depend on it, and each method is there once.
    """
    experiment = find_experiment(name)
    spelt = tuple(make_environment_name(find_task_file(environment)) for environment in request.environments)
    request = replace(request, environments=spelt, methods=tuple(dict.fromkeys(request.methods)))
    check(experiment, request)
    return experiment, request


def make_each(name: str, experiment: Experiment, request: Request) -> None:
    """Run an experiment for each environment, with separate files; the others continue if one fails.

    Raises:
        Exception: one or several failed; raised after all others have finished.
    """
    failed: dict[int, Exception] = {}
    for number, environment in enumerate(request.environments):
        try:
            for path in make(name, experiment, replace(request, environments=(environment,))).files:
                request.report(f"→ {path}")
        except Exception as error:  # raised below, after all others
            request.report(f"{environment} failed: {error}")
            failed[number] = error
    if failed:
        raise combine_errors(failed, len(request.environments))


def make(name: str, experiment: Experiment, request: Request) -> ExperimentRun:
    """Run an experiment on all its environments, and write its files."""
    began = time.monotonic()
    result = experiment.run(request)
    seconds = round(time.monotonic() - began, 1)
    data = {**describe_request(name, experiment.title, request), **result.data, "seconds_of_this_call": seconds}
    files = write(result, data, experiment.title, request, request.folder / format_stem(name, request))
    lines = [*list_warnings(request), *(f"{table.text()}\n" for table in result.tables), *result.notes]
    lines += [f"→ {path}" for path in files.values()]
    places = {key: str(path) for key, path in files.items()}
    return ExperimentRun("\n".join(lines), {**places, **data}, tuple(files.values()))


def describe_request(name: str, title: str, request: Request) -> dict[str, object]:
    """Return the common entries of every experiment's JSON."""
    return {
        "schema": 1,
        "experiment": name,
        "title": title,
        "size": request.sizes.name,
        "warning": next(iter(list_warnings(request)), None),
        "dynamics": request.dynamics,
        "engine": request.engine,
        "ppo": request.sizes.ppo,
        "versions": read_versions(),
        "commit": find_commit(),
    }


def list_warnings(request: Request) -> list[str]:
    """Return the warning above tables of quick runs."""
    return [sentence for sentence in (request.sizes.sentence(),) if sentence]


def write(
    result: ExperimentResult, data: Mapping[str, object], title: str, request: Request, stem: Path
) -> Mapping[str, Path]:
    """Write JSON, tables and pictures; return the files by kind."""
    named = {"result": ".json", "table": ".md", **{f"figure{end}": f"{end}.png" for end in result.pictures}}
    files = {key: stem.with_name(stem.name + end) for key, end in named.items()}
    page = [f"# {title}", *list_warnings(request), *(table.markdown() for table in result.tables), *result.notes]
    write_atomic(files["result"], (json.dumps(make_finite(data), indent=1, allow_nan=False) + "\n").encode())
    write_atomic(files["table"], ("\n\n".join(page) + "\n").encode())
    for end, picture in result.pictures.items():
        write_atomic(files[f"figure{end}"], picture)
    return files


def check(experiment: Experiment, request: Request) -> None:
    """Refuse an impossible request before any work is done."""
    sizes = request.sizes
    if len(request.environments) > 1 and not experiment.several:
        raise OptionError("This experiment is about one environment at a time; give one --env.")
    if not request.environments or len(set(request.environments)) < len(request.environments):
        raise OptionError("Give at least one environment, and none twice.")
    for environment in request.environments:
        task = find_task(environment)
        if request.dynamics not in task.dynamics:
            raise UnknownName("dynamics", request.dynamics, task.dynamics)
    check_methods(request.methods, experiment.methods)
    if not sizes.seeds or min(sizes.seeds) < 0 or len(set(sizes.seeds)) < len(sizes.seeds):
        raise OptionError(f"--seeds {' '.join(map(str, sizes.seeds))}: give different numbers, 0 or more.")
    if sizes.frames < 1:
        raise OptionError(f"--frames is {sizes.frames}; it must be 1 or more.")


def format_stem(name: str, request: Request) -> str:
    """Return the name of an experiment's files, without their endings."""
    names = request.environments
    usual = len(names) > 1 and names == find_experiment(name).environments
    quick = [request.sizes.name] if request.sizes.quick else []
    return "-".join([name, *(() if usual else names), request.target, *quick, *describe_part(request)])


def describe_part(request: Request) -> list[str]:
    """Return words for differences from the whole experiment; none for the whole."""
    ours, full = request.sizes, request.full_sizes or request.sizes
    words = []
    if request.methods and set(request.methods) != set(METHODS):
        order = dict.fromkeys([*METHODS, *sorted(request.methods)])
        words += ["methods", *(method for method in order if method in request.methods)]
    for option in ("seeds", "counts"):
        values = getattr(ours, option)
        words += [option, *map(str, values)] if values != getattr(full, option) else []
    words += ["frames", str(ours.frames)] if ours.frames != full.frames else []
    return [*words, *(["ppo", ours.ppo] if ours.ppo != full.ppo else [])]
