"""The port name `virtual`, which starts a virtual arm for the time of its use."""

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
    """Yield the path of a port: the name itself, or the port of a new virtual arm.

    Args:
        name: A path, or `virtual`.
        effects: Effects of the virtual arm that its model lacks.
        faults: Faults of the virtual arm.
        lockstep: Whether each goal advances the virtual arm by a period, without delays, instead of the clock.
        arm: Options of the virtual arm; those of an ErgoJr if None.

    Raises:
        OptionError: effects, faults or lock-step are given for a real arm.
    """
    if name != VIRTUAL:
        if effects or faults or lockstep:
            raise OptionError(f"Effects, faults and lock-step belong to --port {VIRTUAL}; {name} is a real arm.")
        yield name
        return
    options = replace(
        arm or Options(), effects=tuple(effects), faults=tuple(faults), wire_delay=not lockstep, lockstep=lockstep
    )
    with VirtualBus(options) as bus:
        yield bus.port
