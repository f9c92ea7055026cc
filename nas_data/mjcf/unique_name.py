"""Unique names for elements that are added to a model."""

from collections.abc import Callable


def make_unique_name(find: Callable[[str], object | None], name: str) -> str:
    """Return a name, with a number appended if an element has it already.

    Args:
        find: Returns the element of a name, or None; for example `spec.body`.
        name: Wanted name.
    """
    count, free = 1, name
    while find(free) is not None:
        count += 1
        free = f"{name}_{count}"
    return free
