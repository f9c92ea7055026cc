"""File names of an experiment; they differ by environment, dynamics, sizes and part."""

from nas_data.studies.experiments.base import Request, find_experiment
from nas_data.studies.experiments.pipeline.methods import METHODS


def stem_of(name: str, request: Request) -> str:
    """Return the name of an experiment's files, without their endings."""
    names = request.environments
    usual = len(names) > 1 and names == find_experiment(name).environments
    quick = [request.sizes.name] if request.sizes.quick else []
    return "-".join([name, *(() if usual else names), request.target, *quick, *part_of(request)])


def part_of(request: Request) -> list[str]:
    """Return words for differences from the whole experiment; none for the whole."""
    ours, whole = request.sizes, request.whole or request.sizes
    words = []
    if request.methods and set(request.methods) != set(METHODS):
        order = dict.fromkeys([*METHODS, *sorted(request.methods)])
        words += ["methods", *(method for method in order if method in request.methods)]
    for option in ("seeds", "counts"):
        values = getattr(ours, option)
        words += [option, *map(str, values)] if values != getattr(whole, option) else []
    words += ["frames", str(ours.frames)] if ours.frames != whole.frames else []
    return [*words, *(["ppo", ours.ppo] if ours.ppo != whole.ppo else [])]
