"""Tables of the blind benchmark: rates by family and plant, confusions, reliability of confidence, power."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from nas_data.benchmarks.blind.case import FAMILIES
from nas_data.benchmarks.blind.catalogue import OUTSIDE
from nas_data.benchmarks.blind.grade import CaseGrade, ConfidenceGrade, NamesGrade
from nas_data.benchmarks.blind.record import FAILED, CaseFailure, CaseRecord, GradedAnswer, GradedCase
from nas_data.text_table import align_columns

CONFIDENCES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
MARKS = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
NOTHING = "nothing"
PERCENT = (
    "exact",
    "confident_wrong",
    "abstained",
    "verdict_right",
    "covered",
    "unexplained_joint_named",
    "found",
    "called_complete",
)
ALL = "all"  # in the place of a cause: cases of all causes
TITLES = {
    "families": "Families (before, rest: median error on fresh episodes / noise floor; least: with the true effects)",
    "outside": "A cause outside the catalogue (found: all effects of the catalogue; complete: its joint is called so)",
    "confusions": "Names in cases with one hidden effect, or none",
    "reliability": "Calibration of the confidence",
    "power": "Effects found, by size of their influence [noise floors]",
    "baselines": "Baselines on the same cases",
}
SHORT = {
    "confident_wrong": "conf. wrong", "verdict_right": "verdict ok", "rest_over_floor": "rest",
    "least_over_floor": "least",
    "before_over_floor": "before", "parameter_error": "param. error", "unexplained_joint_named": "joint of rest",
    "called_complete": "complete", "wrong_names": "wrong names", "highest": "highest conf.", "seconds": "s",
}  # fmt: skip

Cell = str | int | float | Mapping[str, int] | None
Row = dict[str, Cell]


def make_tables(records: Sequence[CaseRecord]) -> dict[str, list[Row]]:
    """Return every table of finished cases as rows."""
    grades = [case.grade for case in list_graded(records)]
    groups: dict[tuple[str, str], list[CaseRecord]] = {}  # (family, plant) → records, in order of first appearance
    for record in records:
        groups.setdefault((record.identity.family, record.identity.plant), []).append(record)
    return {
        "families": [summarise_family(*group, members) for group, members in groups.items()],
        "outside": summarise_causes(records),
        "confusions": count_confusions(grades),
        "reliability": compute_reliability([entry for grade in grades for entry in grade.confidences]),
        "power": compute_power(records),
        "baselines": summarise_baselines(records),
    }


def list_graded(records: Sequence[CaseRecord]) -> list[GradedCase]:
    """Return the workflow's results, without failed cases."""
    return [record.outcome for record in records if isinstance(record.outcome, GradedCase)]


def summarise_family(family: str, plant: str, records: Sequence[CaseRecord]) -> Row:
    """Summarise one family on one plant; failed cases count as wrong, but not as confidently wrong."""
    done = list_graded(records)
    grades, errors, failed = [case.grade for case in done], [case.fresh for case in done], len(records) - len(done)
    parameters = [entry for grade in grades for entry in grade.parameters]
    return {
        "family": family,
        "plant": plant,
        "cases": len(records),
        "failed": failed,
        **compute_shares(grades, ("exact", "confident_wrong", "abstained", "verdict_right"), failed),
        "verdicts": Counter([*(str(grade.verdict) for grade in grades), *[FAILED] * failed]),
        "rest_over_floor": median(compute_rest(one.after, one.floor) for one in errors),
        "least_over_floor": median(compute_rest(one.least, one.floor) for one in errors if one.least),
        "before_over_floor": median(compute_rest(one.before, one.floor) for one in errors),
        "parameter_error": median(entry.relative_error for entry in parameters),
        "covered": compute_share(entry.covered for entry in parameters),
        "unexplained_joint_named": compute_share(grade.unexplained_joint_named for grade in grades),
        "seconds": median(case.seconds for case in done),
    }


def summarise_causes(records: Sequence[CaseRecord]) -> list[Row]:
    """Summarise the families with a cause outside the catalogue: all cases of each, then those of each cause."""
    rows: list[Row] = []
    for family in dict.fromkeys(record.identity.family for record in records):
        if not FAMILIES[family].outside:
            continue
        cases = [record for record in records if record.identity.family == family]
        grades = [case.grade for case in list_graded(cases)]
        rows.append(summarise_cause(family, ALL, grades, len(cases) - len(grades)))
        causes = [next(effect for effect, _ in grade.true if effect in OUTSIDE) for grade in grades]
        for cause in sorted(set(causes)):
            own = [grade for grade, name in zip(grades, causes, strict=True) if name == cause]
            rows.append(summarise_cause(family, cause, own))
    return rows


def summarise_cause(family: str, cause: str, grades: Sequence[CaseGrade], failed: int = 0) -> Row:
    """Summarise what was named beside a cause outside the catalogue; in failed cases nothing was found."""
    wrong = [0.0 if one is None else one for grade in grades for one in grade.wrong_confidences]
    shares = compute_shares(grades, ("found", "confident_wrong", "called_complete"), failed)
    return {
        "family": family,
        "cause": cause,
        "cases": len(grades) + failed,
        **(shares if FAMILIES[family].inside else shares | {"found": None}),
        "wrong_names": len(wrong),
        "highest": max(wrong, default=None),
        "covered": compute_share(entry.covered for grade in grades for entry in grade.parameters),
        "names": Counter(effect for grade in grades for effect, _ in grade.extra),
    }


def compute_rest(error: float | None, floor: float) -> float:
    """Return an error on fresh episodes in noise floors; infinite if the model was unusable."""
    return np.inf if error is None else error / floor


def compute_share(flags: Iterable[bool | None], failed: int = 0) -> float | None:
    """Return the share of true flags among known flags and failed cases; None if there are none."""
    known = [flag for flag in flags if flag is not None]
    return sum(known) / (len(known) + failed) if known or failed else None


def compute_shares(grades: Sequence[NamesGrade], names: Sequence[str], failed: int = 0) -> dict[str, float | None]:
    """Return the share of grades with each flag set; failed cases count as false."""
    return {name: compute_share((getattr(grade, name) for grade in grades), failed) for name in names}


def median(values: Iterable[float | None]) -> float | None:
    """Return the median of the known values; None if there are none."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def count_confusions(grades: Sequence[CaseGrade]) -> list[Row]:
    """Count the effects named in cases that hide one effect; joints are ignored."""
    rows: dict[str, Counter[str]] = {}
    for grade in grades:
        if len(grade.true) <= 1:
            row = rows.setdefault(grade.true[0][0] if grade.true else NOTHING, Counter())
            row.update([effect for effect, _ in grade.named] or [NOTHING])
    return [{"true": effect, "named": dict(rows[effect].most_common())} for effect in sorted(rows)]


def compute_reliability(findings: Sequence[ConfidenceGrade]) -> list[Row]:
    """Compare the confidence of findings with how often they were right."""
    known = [(one.confidence, one.right) for one in findings if one.confidence is not None]
    rows: list[Row] = []
    for low, high in pairwise(CONFIDENCES):
        inside = [pair for pair in known if low <= pair[0] < high or (high == 1.0 and pair[0] == 1.0)]
        if inside:
            stated, right = (float(np.mean(values)) for values in zip(*inside, strict=True))
            rows.append({"from": low, "to": high, "findings": len(inside), "confidence": stated, "right": right})
    return rows


def compute_power(records: Sequence[CaseRecord]) -> list[Row]:
    """Return how often single effects were found, by mark in noise floors."""
    catalogued = list_graded([record for record in records if not FAMILIES[record.identity.family].outside])
    single = [case.grade for case in catalogued if len(case.grade.true) == 1]
    rows: list[Row] = []
    for low, high in pairwise((*MARKS, np.inf)):
        inside = [grade for grade in single if low <= grade.marks[0] < high]
        if inside:
            shares = compute_shares(inside, ("exact", "confident_wrong", "abstained"))
            rows.append({"from": low, "to": high, "cases": len(inside), **shares})
    return rows


def summarise_baselines(records: Sequence[CaseRecord]) -> list[Row]:
    """Summarise the baselines by family, over all plants, with the workflow's error for comparison."""
    rows: list[Row] = []
    for name in dict.fromkeys(name for record in records for name in record.baselines):
        for family in dict.fromkeys(record.identity.family for record in records):
            answers = [
                record.baselines[name].outcome
                for record in records
                if record.identity.family == family and name in record.baselines
            ]
            rows.append(summarise_baseline(name, family, answers))
    return rows


def summarise_baseline(name: str, family: str, answers: Sequence[CaseFailure | GradedAnswer]) -> Row:
    """Summarise one baseline on one family."""
    done = [answer for answer in answers if isinstance(answer, GradedAnswer)]
    failed = len(answers) - len(done)
    return {
        "baseline": name,
        "family": family,
        "cases": len(answers),
        "failed": failed,
        **compute_shares([answer.grade for answer in done], ("exact", "confident_wrong"), failed),
        "rest_over_floor": median(compute_rest(answer.fresh.after, answer.fresh.floor) for answer in done),
        "seconds": median(answer.seconds for answer in done),
    }


def print_tables(found: Mapping[str, Sequence[Row]]) -> str:
    """Return all tables that have rows, with their titles."""
    return "\n\n".join(f"{TITLES[name]}\n{align_rows(rows)}" for name, rows in found.items() if rows)


def align_rows(rows: Sequence[Row]) -> str:
    """Format rows with the same keys as a table; words left-aligned, numbers right-aligned."""
    first = rows[0]
    cells = [[SHORT.get(key, key) for key in first], *([format_cell(key, row[key]) for key in first] for row in rows)]
    worded = [number for number, value in enumerate(first.values()) if isinstance(value, str | Mapping)]
    return "\n".join(align_columns(cells, worded))


def format_cell(key: str, value: Cell) -> str:
    """Format one value for a table."""
    if value is None:
        return "–"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in value.items())
    if isinstance(value, str | int):
        return str(value)
    return f"{value:.0%}" if key in PERCENT or key == "right" else f"{value:.3g}"
