"""What every command is: a frozen dataclass whose fields are its options and whose `run` does the work."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import tyro

JsonValue = None | bool | int | float | str | list["JsonValue"] | dict[str, "JsonValue"]


@dataclass(frozen=True)
class CommandResult:
    """What a command did."""

    text: str  # what a person reads; names where the result lies
    data: Mapping[str, object] = field(default_factory=dict)  # the same for machines, printed by `--json`
    ok: bool = True  # False where the command worked but its answer is "no" (a failed verification): exit code 1


@dataclass(frozen=True, kw_only=True)
class Command:
    """Base of the commands; a file `commands/a_b.py` holds the command `nas a b`."""

    json: Annotated[bool, tyro.conf.arg(help="Print one JSON object for machines instead of text.")] = False

    @classmethod
    def spell(cls, arguments: list[str]) -> list[str]:
        """Return the words of the command line as the options below are spelt."""
        return arguments

    def run(self) -> CommandResult:
        """Do the work and say what was done."""
        raise NotImplementedError(f"{type(self).__name__} has no run()")
