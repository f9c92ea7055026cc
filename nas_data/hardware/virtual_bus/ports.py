"""The word `virtual` where a port is asked for: it starts an arm of its own for as long as it is used."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.options import Options
from nas_data.hardware.virtual_bus.process import VirtualBus

VIRTUAL = "virtual"


@contextmanager
def port_of(
    name: str,
    effects: Sequence[str] = (),
    faults: Sequence[str] = (),
    lockstep: bool = False,
    arm: Options | None = None,
) -> Iterator[str]:
    """Yield the path of a port: the name itself, or that of a virtual arm.

    Args:
        name: A path, or `virtual`.
        effects: What the virtual arm has and its model lacks.
        faults: What goes wrong on it.
        lockstep: Whether it moves and answers as fast as it can, a period with every goal, instead of by the clock.
        arm: Which arm it is; an ErgoJr where not given.

    Raises:
        OptionError: effects, faults or lock-step are asked of a real arm.
    """
    if name != VIRTUAL:
        if effects or faults or lockstep:
            raise OptionError(f"Effects, faults and lock-step belong to --port {VIRTUAL}; {name} is a real arm.")
        yield name
        return
    options = replace(
        arm or Options(), effects=tuple(effects), faults=tuple(faults), honest=not lockstep, lockstep=lockstep
    )
    with VirtualBus(options) as bus:
        yield bus.port
