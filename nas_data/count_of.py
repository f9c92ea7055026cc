"""A count and its noun as people write them: `1 episode`, `2 episodes`."""


def count_of(count: int, noun: str, form: str = "", plural: str = "") -> str:
    """Return a count with its noun, in the singular where it is one.

    Args:
        count: How many.
        noun: What, in the singular.
        form: Format of the number, such as `,` for thousands.
        plural: The noun's plural where it is not made with an s.
    """
    return f"{count:{form}} {noun if count == 1 else plural or f'{noun}s'}"
