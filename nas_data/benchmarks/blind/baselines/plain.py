"""The plain fit of `nas gap` alone: every smooth parameter of every joint; names no effect."""

from pathlib import Path

import numpy as np

from nas_data.benchmarks.blind.baselines.base import Claim
from nas_data.gap.nominal import with_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.search.plain_fit import fit_plain
from nas_data.gap.search.search import Search
from nas_data.simulators.initial_states import InitialLoad


def answer(dataset: Path, model: Path) -> Claim:
    """Fit all smooth parameters; name nothing."""
    problem = Problem.load(dataset, str(model))
    search = Search.begin(problem.train, problem.held)
    plain = fit_plain(search)
    nominal = with_timestep(problem.train.nominal, search.task.timestep)
    simulator = nominal.simulator(plain.effects, plain.fit.factors)

    def predict(commands: np.ndarray, first: np.ndarray) -> np.ndarray:
        holds = np.full((len(commands), commands.shape[2]), InitialLoad.GRAVITY)
        return simulator.rollout(first, commands, holds)[..., : commands.shape[2]]

    return Claim((), predict)
