"""Plain fit as a source for comparisons."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid
from nas_data.gap.nominal import with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.simulators.mujoco import MujocoSimulator


@threadpool_limits.wrap(limits=1, user_api="blas")  # idle BLAS threads would occupy cores of the rollouts
def fit_plain_source(
    dataset: Dataset, model: str | Path, root: Path | None, say: Callable[[str], None]
) -> MujocoSimulator:
    """Fit gain, damping, rotor inertia, dry and viscous friction, and offset of a model to a recording.

    Args:
        dataset: Transitions of at least two episodes.
        model: Robot's name or model file.
        root: Folder of the dataset, for errors; None if it is only in memory.
        say: Receives progress messages.

    Returns:
        Simulator of the fitted model at the dataset's rate.

    Raises:
        NasError: dataset or model cannot be used, or the recording has several position gains.
    """
    problem = Problem.of(dataset, model, root)
    gains = np.unique(problem.evidence.gains, axis=0)
    if len(gains) > 1:
        raise DatasetInvalid("the recording has several position gains; give the episodes of one of them.")
    search = Search.begin(problem.train, problem.held, say)
    plain = fit_plain(search)
    task = replace(problem.train, fine=search.task.fine)
    nominal = with_timestep(problem.held.nominal, task.timestep).with_gains(gains[0])
    return nominal.simulator(plain.effects, plain.fit.factors)
