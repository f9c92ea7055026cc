"""The plain fit as a source: every smooth parameter of every joint fitted to a recording, with no name given."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from nas_data.dataset.dataset import Dataset
from nas_data.gap.nominal import with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.simulators.mujoco import MujocoSimulator


@threadpool_limits.wrap(limits=1, user_api="blas")  # it would wait busily on the cores that the rollouts need
def fit_plain_source(dataset: Dataset, model: str | Path, name: Path, say: Callable[[str], None]) -> MujocoSimulator:
    """Fit a model's smooth parameters: gain, damping, rotor inertia, dry and viscous friction, offset.

    Args:
        dataset: Transitions of at least two episodes.
        model: A robot's name or a model file.
        name: What to call the dataset in errors.
        say: Told what is going on.

    Returns:
        The fitted model at the dataset's rate.

    Raises:
        NasError: dataset or model cannot be used.
    """
    problem = Problem.of(dataset, model, name)
    search = Search.begin(problem.train, problem.held, say)
    plain = fit_plain(search)
    task = replace(problem.train, fine=search.task.fine)
    nominal = with_timestep(problem.held.nominal, task.timestep)
    return nominal.simulator(plain.effects, plain.fit.factors)
