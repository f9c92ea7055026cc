"""Base of the commands: a frozen dataclass whose fields are its options and whose `run` does the work."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import tyro

JsonValue = None | bool | int | float | str | list["JsonValue"] | dict[str, "JsonValue"]


@dataclass(frozen=True)
class CommandResult:
    """Result of a command."""

    text: str  # text output, with the path of the result
    data: Mapping[str, object] = field(default_factory=dict)  # the result as JSON, printed with `--json`
    ok: bool = True  # False for a negative answer (a failed verification): exit code 1


@dataclass(frozen=True, kw_only=True)
class Command:
    """Base of the commands; a file `commands/a_b.py` holds the command `nas a b`."""

    json: Annotated[bool, tyro.conf.arg(help="Print the result as one JSON object instead of text.")] = False

    @classmethod
    def normalise_arguments(cls, arguments: list[str]) -> list[str]:
        """Return the command-line words with options renamed to the fields below."""
        return arguments

    def run(self) -> CommandResult:
        """Do the work and return the result."""
        raise NotImplementedError(f"{type(self).__name__} has no run()")
