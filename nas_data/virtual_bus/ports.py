"""The word `virtual` where a port is asked for: it starts an arm of its own for as long as it is used."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from nas_data.errors import OptionError
from nas_data.virtual_bus.options import Options
from nas_data.virtual_bus.process import VirtualBus

VIRTUAL = "virtual"


@contextmanager
def port_of(name: str, effects: Sequence[str] = (), faults: Sequence[str] = ()) -> Iterator[str]:
    """Yield the path of a port: the name itself, or that of a virtual arm.

    Args:
        name: A path, or `virtual`.
        effects: What the virtual arm has and its model lacks.
        faults: What goes wrong on it.

    Raises:
        OptionError: effects or faults are asked of a real arm.
    """
    if name != VIRTUAL:
        if effects or faults:
            raise OptionError(f"--effect and --fault belong to --port {VIRTUAL}; {name} is a real arm.")
        yield name
        return
    with VirtualBus(Options(effects=tuple(effects), faults=tuple(faults))) as bus:
        yield bus.port
