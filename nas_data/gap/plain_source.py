"""Plain fit as a source for comparisons."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from nas_data.count_of import join_items
from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid
from nas_data.gap.nominal import with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.servo_registers import ServoRegisters


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
        NasError: dataset or model cannot be used, or registers differ between its episodes.
    """
    if several := ServoRegisters.of(dataset, root).changing:
        raise DatasetInvalid(f"its episodes differ in {join_items(several)}; give those of one setting")
    problem = Problem.of(dataset, model, root)
    search = Search.begin(problem.train, problem.held, say)
    plain = fit_plain(search)
    task = replace(problem.train, fine=search.task.fine)
    nominal = with_timestep(problem.held.nominal, task.timestep)
    return nominal.simulator(plain.effects, plain.fit.factors)
