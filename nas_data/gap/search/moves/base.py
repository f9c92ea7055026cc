"""What a move is: one kind of step from a hypothesis to a better one."""

from typing import Protocol

from nas_data import registry
from nas_data.gap.search.hypothesis import Hypothesis
from nas_data.gap.search.search import Search


class Move(Protocol):
    """A step of the search; the file `moves/NAME.py` holds the move NAME as its function `apply`."""

    def __call__(self, search: Search, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis of a better score by the present objective, or the one given."""


def find_move(name: str) -> Move:
    """Return a move by its name.

    Raises:
        UnknownName: there is no such move; lists those there are.
    """
    move: Move = registry.module("gap.search.moves", name, "move").apply
    return move
