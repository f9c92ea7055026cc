"""Formatting of counts and lists in sentences: `1 episode`, `2 episodes`; `a, b and c`."""

from collections.abc import Sequence


def count_of(count: int, noun: str, form: str = "", plural: str = "") -> str:
    """Return a count with its noun, singular for 1.

    Args:
        count: Number.
        noun: Singular noun.
        form: Format of the number, such as `,` for thousands.
        plural: Irregular plural; empty for one with s.
    """
    return f"{count:{form}} {noun if count == 1 else plural or f'{noun}s'}"


def join_items(items: Sequence[str]) -> str:
    """Return items as a phrase: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)
