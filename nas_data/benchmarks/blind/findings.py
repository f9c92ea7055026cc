"""Gap report in the contract's form, as far as it is graded."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from nas_data.errors import DatasetInvalid
from nas_data.typed_json import FormError, from_json

Name = tuple[str, str | None]  # effect, joint; None for the whole arm
SAME = ""  # joint of an alternative that names none: the joint of the effect beside it


@dataclass(frozen=True)
class ReportedEffect:
    """One claimed effect."""

    name: Name  # effect and joint
    parameters: Mapping[str, float]  # parameter → value
    intervals: Mapping[str, tuple[float, float]]  # parameter → its 95 % interval, if one is given
    confidence: float  # between 0 and 1
    alternatives: tuple[Name, ...]  # effects listed beside it


@dataclass(frozen=True)
class ParameterEntry:
    """Parameter of an effect in a report; a number that is not finite is null."""

    value: float | None
    interval95: tuple[float | None, float | None] | None = None


@dataclass(frozen=True)
class AlternativeEntry:
    """Alternative to an effect in a report."""

    effect: str
    joint: str | None = SAME


@dataclass(frozen=True)
class EffectEntry:
    """Effect in a report."""

    effect: str
    joint: str | None
    parameters: Mapping[str, ParameterEntry]
    confidence: float | None
    alternatives: tuple[AlternativeEntry, ...] | None = None

    def claim(self) -> ReportedEffect:
        """Return the entry with plain numbers."""
        intervals = {key: one.interval95 for key, one in self.parameters.items() if one.interval95 is not None}
        return ReportedEffect(
            (self.effect, self.joint),
            {key: read_number(one.value) for key, one in self.parameters.items()},
            {key: (read_number(low, math.inf), read_number(high, math.inf)) for key, (low, high) in intervals.items()},
            read_number(self.confidence),
            tuple((one.effect, self.joint if one.joint == SAME else one.joint) for one in self.alternatives or ()),
        )


@dataclass(frozen=True)
class UnexplainedEntry:
    """Joint with an unexplained gap in a report."""

    joint: str | None = None


@dataclass(frozen=True)
class ReportEntries:
    """The graded entries of a report."""

    effects: tuple[EffectEntry, ...]
    verdict: str | None = None
    unexplained: tuple[UnexplainedEntry, ...] | None = None

    @classmethod
    def of(cls, report: Mapping[str, object]) -> "ReportEntries":
        """Read a report.

        Raises:
            DatasetInvalid: it does not have the contract's form.
        """
        try:
            return from_json(cls, report)
        except FormError as error:
            raise DatasetInvalid(f"The report has not the contract's form: {error}.") from None


def read_number(value: float | None, missing: float = math.nan) -> float:
    """Return a number; JSON has none for what is not finite."""
    return missing if value is None else value
