"""Plant in NumPy, written from the equations without a physics engine; all episodes in one batch."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from nas_data.benchmarks.blind.plants.base import Play, make_chain, make_simulation
from nas_data.benchmarks.blind.plants.hiding import PlantBody
from nas_data.benchmarks.blind.plants.motion import PlantState


@contextmanager
def open_chain(
    bodies: list[PlantBody], numbers: dict[str, np.ndarray], state: PlantState
) -> Iterator[Callable[[], None]]:
    """Yield a function that advances all arms by `REFRESH`, as `OpenPhysics` requires."""
    chain = make_chain(numbers)
    yield lambda: state.advance(*chain.dynamics(*state.middle()))


play = Play(make_simulation(open_chain))
