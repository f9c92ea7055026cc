"""Interface of faults: a fault changes the arm at a given time, or disturbs the bus from then on."""

from dataclasses import dataclass, fields

import numpy as np

from nas_data import registry
from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.servo import VirtualServo


class LineGone(Exception):
    """The adapter and its port have vanished."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Base of the faults; the file `faults/a_b.py` holds the fault `a_b` as class `AB`."""

    after: float = 0.0  # time after the start of the bus at which it begins [s]

    @classmethod
    def name(cls) -> str:
        """Return the fault's name, which is the name of its file."""
        return cls.__module__.rsplit(".", 1)[-1]

    def apply(self, arm: VirtualArm) -> None:
        """Apply the fault to the arm, once.

        Raises:
            LineGone: the line is gone.
        """

    def instruction(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Return the instruction bytes as the servos receive them."""
        return content

    def reply(self, content: bytes, rng: np.random.Generator) -> bytes:
        """Return the bytes of a reply as the computer receives them."""
        return content

    def delay(self, rng: np.random.Generator) -> float:
        """Return the extra delay of replies [s]."""
        return 0.0


def find_servo(arm: VirtualArm, identity: int) -> VirtualServo:
    """Return the servo with an ID that a fault names.

    Raises:
        OptionError: the arm has no such servo.
    """
    servos = arm.chain.find_servos(identity)
    if not servos:
        known = ", ".join(str(servo.get("id")) for servo in arm.chain.servos)
        raise OptionError(f"A fault names servo {identity}; the virtual arm has: {known}.")
    return servos[0]


def find_fault(name: str) -> type[Fault]:
    """Return the class of a fault by its name.

    Raises:
        UnknownName: there is no such fault; the message lists the known ones.
    """
    return registry.find_plugin("hardware.virtual_bus.faults", name, "fault", Fault)


def parse(text: str) -> Fault:
    """Parse a fault such as `unplugged:servo=3,after=20`.

    Raises:
        UnknownName: there is no such fault.
        OptionError: the text is malformed, or a parameter is unknown.
    """
    name, _, rest = text.partition(":")
    kind = find_fault(name)
    known = {field.name: field.type for field in fields(kind)}
    pairs = [part.partition("=") for part in rest.split(",") if part]
    unknown = [key for key, _, _ in pairs if key.strip() not in known]
    if unknown:
        raise OptionError(f"{name} has no parameter '{unknown[0]}'; it has: {', '.join(sorted(known))}.")
    try:
        values = {key.strip(): int(value) if known[key.strip()] is int else float(value) for key, _, value in pairs}
        return kind(**values)
    except (ValueError, TypeError):
        raise OptionError(f"'{text}' is not a fault; write NAME:PARAMETER=NUMBER,… with: {', '.join(known)}.") from None
