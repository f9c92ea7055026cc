"""Interface of moves."""

from typing import Protocol

from nas_data import registry
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search


class Move(Protocol):
    """A step of the search; the file `moves/NAME.py` implements the move NAME as `apply`."""

    def __call__(self, search: Search, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis with a better score by the present objective, or the given one."""


def find_move(name: str) -> Move:
    """Return a move by its name.

    Raises:
        UnknownName: there is no such move; the message lists the known ones.
    """
    move: Move = registry.import_plugin("gap.search.moves", name, "move").apply
    return move
