"""Counts and lists as people write them: `1 episode`, `2 episodes`; `a, b and c`."""

from collections.abc import Sequence


def count_of(count: int, noun: str, form: str = "", plural: str = "") -> str:
    """Return a count with its noun, in the singular where it is one.

    Args:
        count: How many.
        noun: What, in the singular.
        form: Format of the number, such as `,` for thousands.
        plural: The noun's plural where it is not made with an s.
    """
    return f"{count:{form}} {noun if count == 1 else plural or f'{noun}s'}"


def join_items(items: Sequence[str]) -> str:
    """Return items as a phrase: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)
