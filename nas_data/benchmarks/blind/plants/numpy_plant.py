"""An arm written in NumPy from the equations alone, no physics engine beneath: every episode at once."""

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
    """Yield what moves all arms on by `REFRESH`; see `OpenPhysics`."""
    chain = make_chain(numbers)
    yield lambda: state.advance(*chain.dynamics(*state.middle()))


play = Play(make_simulation(open_chain))
