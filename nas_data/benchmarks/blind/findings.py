"""What a report claims and what is true, in one form: effects by name and joint."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from nas_data.errors import DatasetInvalid

Name = tuple[str, str | None]  # effect, joint; None for the whole arm


@dataclass(frozen=True)
class ReportedEffect:
    """One claimed effect.

    Attributes:
        name: Effect and joint.
        parameters: Parameter → value.
        intervals: Parameter → its 95 % interval, where one is given.
        confidence: Between 0 and 1.
        alternatives: Effects listed beside it.
    """

    name: Name
    parameters: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    confidence: float
    alternatives: tuple[Name, ...]


def read_findings(report: Mapping[str, object]) -> list[ReportedEffect]:
    """Read the effects of a report.

    Raises:
        DatasetInvalid: it has not the contract's form.
    """
    try:
        return [finding_of(entry) for entry in read_list(report["effects"])]
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetInvalid(f"The report has not the contract's form: {error!r}.") from None


def finding_of(entry: Mapping[str, object]) -> ReportedEffect:
    """Read one effect."""
    joint = entry["joint"]
    values, intervals = {}, {}
    for key, item in mapping(entry["parameters"]).items():
        values[key] = number(mapping(item)["value"])
        if (interval := mapping(item).get("interval95")) is not None:
            low, high = (number(end, math.inf) for end in sequence(interval))
            intervals[key] = (low, high)
    beside = [
        (str(other["effect"]), text(other.get("joint", joint))) for other in read_list(entry.get("alternatives") or [])
    ]
    return ReportedEffect(
        (str(entry["effect"]), text(joint)), values, intervals, number(entry["confidence"]), tuple(beside)
    )


def text(value: object) -> str | None:
    """Return a joint's name or None."""
    return None if value is None else str(value)


def number(value: object, missing: float = math.nan) -> float:
    """Return a number; JSON has none for what is not finite."""
    return missing if value is None else float(str(value))


def mapping(value: object) -> Mapping[str, object]:
    """Return a JSON object."""
    if not isinstance(value, Mapping):
        raise TypeError(f"an object is needed, given {value!r}")
    return value


def sequence(value: object) -> Sequence[object]:
    """Return a JSON list."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"a list is needed, given {value!r}")
    return value


def read_list(value: object) -> list[Mapping[str, object]]:
    """Return a JSON list of objects."""
    return [mapping(item) for item in sequence(value)]
