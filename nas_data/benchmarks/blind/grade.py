"""Grade of a case: the gap report, in the contract's form, compared with the sealed answer."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from nas_data.benchmarks.blind.case import HiddenEntry, Name, SealedAnswer
from nas_data.benchmarks.blind.catalogue import OUTSIDE
from nas_data.errors import DatasetInvalid
from nas_data.typed_json import FormError, from_json

SAME = ""  # joint of an alternative that names none: that of its effect


@dataclass(frozen=True)
class ReportedEffect:
    """One claimed effect."""

    name: Name  # effect and joint
    parameters: Mapping[str, float]  # parameter → value
    intervals: Mapping[str, tuple[float, float]]  # parameter → its 95 % interval, if one is given
    confidence: float  # between 0 and 1
    alternatives: tuple[Name, ...]  # alternatives listed for it


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
        """Return the entry with floats in place of nulls."""
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
class JointEntry:
    """Description of a joint in a report."""

    complete: float | None = None


@dataclass(frozen=True)
class ReportEntries:
    """The graded entries of a report."""

    effects: tuple[EffectEntry, ...]
    verdict: str | None = None
    unexplained: tuple[UnexplainedEntry, ...] | None = None
    joints: Mapping[str, JointEntry] | None = None

    @classmethod
    def of(cls, report: Mapping[str, object]) -> "ReportEntries":
        """Read a report.

        Raises:
            DatasetInvalid: it does not have the contract's form.
        """
        try:
            return from_json(cls, report)
        except FormError as error:
            raise DatasetInvalid(f"The report does not have the required structure: {error}.") from None


def read_number(value: float | None, missing: float = math.nan) -> float:
    """Return a number, or `missing` for null, which JSON holds for values that are not finite."""
    return missing if value is None else value


CONFIDENT = 0.8  # wrong names of at least this confidence count as the worst outcome; so do complete joints
ABOVE_FLOOR = frozenset({"unexplained", "partly_explained"})
PLACE = frozenset("xyz")  # position of a payload; if none is reported, it is at the link's centre of mass
RIGHT_VERDICTS = {
    "none": frozenset({"none", "retuned"}),  # errors of the base parameters can justify `retuned`
    "one": frozenset({"explained"}),
    "outside": ABOVE_FLOOR,
}


@dataclass(frozen=True)
class NamesGrade:
    """Named effects compared with the hidden ones."""

    exact: bool  # whether they are the same sets
    missing: tuple[Name, ...]  # hidden effects that are not named
    extra: tuple[Name, ...]  # named effects that are not hidden
    wrong_joint: tuple[Name, ...]  # extra names whose effect is hidden in another joint
    listed_beside: tuple[Name, ...]  # missing names that are listed as alternatives
    abstained: bool  # whether nothing is named although something is hidden
    confident_wrong: bool  # whether a wrong name has a high confidence
    confident_wrong_without_the_true_one_beside: bool  # the same, and no missing name is among its alternatives

    @property
    def found(self) -> bool:
        """Whether all hidden effects are named, whatever else is named beside them."""
        return not self.missing


@dataclass(frozen=True)
class ConfidenceGrade:
    """Confidence of a finding, null in JSON if not finite, and whether it is right."""

    confidence: float | None
    right: bool


@dataclass(frozen=True)
class ParameterGrade:
    """Relative error of a parameter, and whether its interval, if any, covers the truth.

    Errors that are not finite are null in JSON.
    """

    effect: str
    parameter: str
    relative_error: float | None
    covered: bool | None


@dataclass(frozen=True)
class CaseGrade(NamesGrade):
    """Grade of a report."""

    true: tuple[Name, ...]  # hidden effects
    named: tuple[Name, ...]  # named effects
    marks: tuple[float, ...]  # mark of each hidden effect
    verdict: str | None  # verdict of the report
    verdict_right: bool  # whether the verdict is right
    confidences: tuple[ConfidenceGrade, ...]  # confidence of each finding
    parameters: tuple[ParameterGrade, ...]  # parameters of the effects that are named rightly
    # whether the report marks the joint of an effect outside the catalogue as unexplained; None without such an effect
    unexplained_joint_named: bool | None
    # whether the report calls a joint on which it acts complete with a high confidence; None without such an effect
    called_complete: bool | None = None

    @property
    def wrong_confidences(self) -> tuple[float | None, ...]:
        """Confidence of each wrong name."""
        return tuple(entry.confidence for entry in self.confidences if not entry.right)


def grade_names(answer: SealedAnswer, report: Mapping[str, object]) -> CaseGrade:
    """Compare the content of a `report.json` with the sealed answer of its case.

    Raises:
        DatasetInvalid: the report does not have the contract's form.
    """
    entries = ReportEntries.of(report)
    beyond = [entry for entry in answer.effects if entry.effect in OUTSIDE]
    inside = [entry for entry in answer.effects if entry not in beyond]
    true = [entry.name for entry in inside]
    findings = [entry.claim() for entry in entries.effects]
    meant = [translate(inside, answer.joints, finding) for finding in findings]
    all_meant = [finding for group in meant for finding in group]
    unexplained = {entry.joint for entry in entries.unexplained or ()}
    right = RIGHT_VERDICTS["outside" if beyond else "one" if inside else "none"]
    return CaseGrade(
        **vars(compare_names(true, all_meant)),
        true=tuple(entry.name for entry in answer.effects),
        named=tuple(finding.name for finding in findings),
        marks=tuple(entry.mark for entry in answer.effects),
        verdict=entries.verdict,
        verdict_right=entries.verdict in right,
        confidences=tuple(
            ConfidenceGrade(finding.confidence, all(part.name in true for part in parts))
            for finding, parts in zip(findings, meant, strict=True)
        ),
        parameters=tuple(compute_parameter_errors([as_the_model_sees(entry, answer) for entry in inside], all_meant)),
        unexplained_joint_named=any(entry.marked_joint in unexplained for entry in beyond) if beyond else None,
        called_complete=is_called_complete(beyond, entries.joints or {}) if beyond else None,
    )


def is_called_complete(beyond: Sequence[HiddenEntry], joints: Mapping[str, JointEntry]) -> bool:
    """Whether any joint on which an effect outside the catalogue acts is reported as complete with high confidence."""
    acted = {joint for entry in beyond for joint in entry.felt_joints or (entry.marked_joint,)}
    return any(read_number(joints[joint].complete) >= CONFIDENT for joint in acted & set(joints))


def translate(hidden: Sequence[HiddenEntry], joints: Sequence[str], finding: ReportedEffect) -> list[ReportedEffect]:
    """Return a finding under the names of the hidden effects, if they are equivalent.

    An effect of the whole arm matches the same effect hidden in every joint. Some effects have two names.
    """
    true, (effect, joint) = [entry.name for entry in hidden], finding.name
    if finding.name in true:
        return [finding]
    everywhere = [(effect, name) for name in joints]
    if joint is None and everywhere and all(name in true for name in everywhere):
        return [replace(finding, name=name) for name in everywhere]
    same = [entry.name for entry in hidden if finding.name in (entry.equals or ())]
    return [replace(finding, name=name, parameters={}, intervals={}) for name in same] or [finding]


def compare_names(true: Sequence[Name], findings: Sequence[ReportedEffect]) -> NamesGrade:
    """Compare named effects with the hidden ones."""
    named = [finding.name for finding in findings]
    missing = tuple(name for name in true if name not in named)
    extra = tuple(name for name in named if name not in true)
    sure = [finding for finding in findings if finding.name not in true and finding.confidence >= CONFIDENT]
    beside = {name for finding in findings for name in finding.alternatives}
    return NamesGrade(
        exact=sorted(map(str, true)) == sorted(map(str, named)),
        missing=missing,
        extra=extra,
        wrong_joint=tuple(name for name in extra if name[0] in {effect for effect, _ in missing}),
        listed_beside=tuple(name for name in missing if name in beside),
        abstained=bool(true) and not named,
        confident_wrong=bool(sure),
        confident_wrong_without_the_true_one_beside=any(not set(one.alternatives) & set(missing) for one in sure),
    )


def compute_parameter_errors(hidden: Sequence[HiddenEntry], findings: Sequence[ReportedEffect]) -> list[ParameterGrade]:
    """Return the relative error of each parameter of each correctly named effect."""
    by_name = {finding.name: finding for finding in findings if finding.parameters}
    rows = []
    for entry in hidden:
        finding = by_name.get(entry.name)
        for key, value in entry.parameters.items() if finding else ():
            assert finding is not None
            found = finding.parameters.get(key, 0.0 if key in PLACE else math.nan)
            interval = finding.intervals.get(key)
            covered = None if interval is None else interval[0] <= value <= interval[1]
            error = abs(found - value) / compute_reference_size(entry.effect, entry.parameters, key)
            rows.append(ParameterGrade(entry.effect, key, error, covered))
    return rows


def as_the_model_sees(entry: HiddenEntry, answer: SealedAnswer) -> HiddenEntry:
    """Return a hidden effect with its gain relative to the given model, as the contract defines it.

    The plant's base gain differs from the model's as well, and no data separate the two factors.
    """
    if entry.effect != "servo_stiffness" or entry.joint is None:
        return entry
    own = answer.base.stiffness[answer.joints.index(entry.joint)]
    return replace(entry, parameters={"factor": entry.parameters["factor"] * own})


def compute_reference_size(effect: str, true: Mapping[str, float], key: str) -> float:
    """Return the denominator of a relative error; for components of a vector (tilt, position), its norm."""
    if effect == "base_tilt":
        return math.hypot(*true.values())
    return math.hypot(*(true[axis] for axis in PLACE if axis in true)) if key in PLACE else abs(true[key])
