"""A name for an element that is added to somebody's model, whatever names it has already."""

from collections.abc import Callable


def free_name(find: Callable[[str], object | None], name: str) -> str:
    """Return a name, with a number behind it where an element has it already.

    Args:
        find: Returns the element of a name, None where there is none; for example `spec.body`.
        name: The name to begin with.
    """
    count, free = 1, name
    while find(free) is not None:
        count += 1
        free = f"{name}_{count}"
    return free
