"""Outcome of a trial: what was named after each known change, how large, and how many names are right."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from nas_data.effects.base import Effect
from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import EffectName, NamedEffect
from nas_data.gap.showing.page_words import format_value
from nas_data.studies.trial.change import KnownChange

SURE = 0.5  # confidence from which a name counts as given
RIGHT_SIZE = 0.15  # largest relative error of a right size
NOTHING = "nothing"


@dataclass(frozen=True, kw_only=True)
class GivenName(EffectName):
    """A name that a gap report gives.

    Attributes:
        confidence: Its confidence.
        value: Value of the change's parameter, if it has this parameter [SI].
        interval95: 95 % interval of that value, if it is known.
    """

    confidence: float
    value: float | None = None
    interval95: tuple[float, float] | None = None

    @classmethod
    def of(cls, found: NamedEffect, parameter: str) -> "GivenName":
        """Return a finding of a report, with one of its parameters."""
        number = found.parameters.get(parameter)
        return cls(
            name=found.name,
            joint=found.joint,
            confidence=found.confidence,
            value=None if number is None else number.value,
            interval95=None if number is None else number.interval95,
        )


@dataclass(frozen=True, kw_only=True)
class ChangeOutcome:
    """What was named after a known change.

    Attributes:
        change: Name of the change.
        does: What was changed, in words.
        true: Effect as which it should be named.
        parameter: Parameter of the effect with the known size.
        size: Its known size, in `unit`.
        unit: SI unit.
        named: All names of the report, highest confidence first.
        verdict: Verdict of the report.
    """

    change: str
    does: str
    true: EffectName
    parameter: str
    size: float
    unit: str
    named: tuple[GivenName, ...]
    verdict: str

    @classmethod
    def of(
        cls, change: KnownChange, expected: Effect, report: GapReport, slides: Collection[str] = ()
    ) -> "ChangeOutcome":
        """Compare a report with the effect that it should name.

        Args:
            change: The change.
            expected: Effect that should be named.
            report: The report.
            slides: Names of the slides.
        """
        return cls(
            change=change.name,
            does=change.does,
            true=EffectName(name=expected.name(), joint=expected.joint),
            parameter=change.parameter,
            size=float(getattr(expected, change.parameter)),
            unit=change.find_unit(expected.joint in slides),
            named=tuple(GivenName.of(found, change.parameter) for found in report.effects),
            verdict=report.verdict,
        )

    @property
    def match(self) -> GivenName | None:
        """The name that equals the true one, whatever its confidence; None if there is none."""
        true = (self.true.name, self.true.joint)
        return next((given for given in self.named if (given.name, given.joint) == true), None)

    @property
    def sure(self) -> tuple[GivenName, ...]:
        """The names that count as given."""
        return tuple(given for given in self.named if given.confidence >= SURE)

    @property
    def is_right(self) -> bool:
        """Whether exactly the true effect is named."""
        return self.match is not None and self.sure == (self.match,)

    @property
    def relative_error(self) -> float | None:
        """Relative error of the size; None if the true effect is not named."""
        if self.match is None or self.match.value is None:
            return None
        return abs(self.match.value / self.size - 1)

    @property
    def has_right_size(self) -> bool:
        """Whether the name is right, and its size is, too."""
        return self.is_right and self.relative_error is not None and self.relative_error <= RIGHT_SIZE

    def describe_given(self, given: GivenName) -> str:
        """Return a given name with its size and confidence, in words."""
        size = "" if given.value is None else f" {format_value(given.value, self.unit)}"
        return f"{given}{size} (confidence {given.confidence:.2f})"

    def line(self) -> str:
        """Return the outcome in one line."""
        named = ", ".join(self.describe_given(given) for given in self.sure) or NOTHING
        unsure = ", ".join(self.describe_given(given) for given in self.named if given not in self.sure)
        error = "" if self.relative_error is None else f"; size off by {100 * self.relative_error:.1f} %"
        return (
            f"{self.change}: named: {named}{f', unsure: {unsure}' if unsure else ''}  true: {self.true} "
            f"{format_value(self.size, self.unit)}  {'right' if self.is_right else 'wrong'}{error}"
        )


@dataclass(frozen=True, kw_only=True)
class TrialOutcome:
    """Outcome of all changes; the content of `trial.json`.

    Attributes:
        schema: Version of the file's format.
        arm: The arm.
        model: Model that the baseline is compared with.
        baseline: Names in the baseline's own report: what the arm has that the model lacks.
        baseline_verdict: Verdict of that report.
        changes: Outcome of each change.
        skipped: Changes that were not made, each with the reason.
    """

    schema: int = 1
    arm: str
    model: str
    baseline: tuple[EffectName, ...]
    baseline_verdict: str
    changes: tuple[ChangeOutcome, ...]
    skipped: tuple[str, ...] = ()

    @property
    def right(self) -> Sequence[ChangeOutcome]:
        """The changes that are named rightly."""
        return [outcome for outcome in self.changes if outcome.is_right]

    @property
    def right_sizes(self) -> Sequence[ChangeOutcome]:
        """Those of them with the right size."""
        return [outcome for outcome in self.changes if outcome.has_right_size]

    def sentence(self) -> str:
        """Return the result in a sentence."""
        n = len(self.changes)
        return f"{len(self.right)} of {n} named, {len(self.right_sizes)} of {n} with size within {RIGHT_SIZE:.0%}."

    def describe_baseline(self) -> str:
        """Return the baseline's report in a sentence."""
        names = ", ".join(map(str, self.baseline)) or NOTHING
        return f"baseline: {self.baseline_verdict}; the arm has, and {self.model} lacks: {names}"

    def lines(self) -> list[str]:
        """Return the outcome as lines of text."""
        return [
            self.describe_baseline(),
            *(outcome.line() for outcome in self.changes),
            *(f"skipped: {reason}" for reason in self.skipped),
            self.sentence(),
        ]
