"""Jobs that fail, in a module that a worker process loads at once."""

from nas_data.errors import SimulationDiverged, UnknownName


def half(number: int) -> int:
    """Do every other job."""
    if number % 2:
        raise SimulationDiverged(f"number {number} left all bounds.")
    return number


def named(number: int) -> None:
    """Know no number."""
    raise UnknownName("number", str(number), ["one"])
