"""Grading one case: what the report says against the sealed answer."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from nas_data.benchmarks.blind.catalogue import OUTSIDE
from nas_data.benchmarks.blind.findings import (
    Name,
    ReportedEffect,
    mapping,
    number,
    read_findings,
    read_list,
    sequence,
    text,
)

CONFIDENT = 0.8  # from here on a wrong name is the worst outcome
ABOVE_FLOOR = frozenset({"unexplained", "partly_explained"})
PLACE = frozenset("xyz")  # of a payload; where none is reported, it is at the link's centre of mass
RIGHT_VERDICTS = {"none": frozenset({"none", "retuned"}), "outside": ABOVE_FLOOR}


def grade_names(answer: Mapping[str, object], report: Mapping[str, object]) -> dict[str, object]:
    """Compare a report with the answer of its case.

    Args:
        answer: As `answer.json` holds it.
        report: As the contract has it.

    Returns:
        What `tables` needs: names, confidences, parameter errors, verdict.

    Raises:
        DatasetInvalid: the report has not the contract's form.
    """
    hidden = read_list(answer["effects"])
    beyond = [entry for entry in hidden if entry["effect"] in OUTSIDE]
    inside = [entry for entry in hidden if entry not in beyond]
    true = [name_of(entry) for entry in inside]
    findings = read_findings(report)
    named = [finding.name for finding in findings]
    meant = [in_words_of(inside, answer, finding) for finding in findings]
    all_meant = [finding for group in meant for finding in group]
    return {
        "true": [name_of(entry) for entry in hidden],
        "named": named,
        "marks": [number(entry["mark"]) for entry in hidden],
        "verdict": report.get("verdict"),
        "verdict_right": is_verdict_right("outside" if beyond else "one" if inside else "none", report.get("verdict")),
        **compare_names(true, all_meant),
        "confidences": [
            {"confidence": finding.confidence, "right": all(part.name in true for part in parts)}
            for finding, parts in zip(findings, meant, strict=True)
        ],
        "parameters": parameter_errors([as_the_model_sees(entry, answer) for entry in inside], all_meant),
        "unexplained_joint_named": joint_named(beyond, report) if beyond else None,
    }


def in_words_of(
    hidden: Sequence[Mapping[str, object]], answer: Mapping[str, object], finding: ReportedEffect
) -> list[ReportedEffect]:
    """Return a finding by the names of what hides, where it says the same in others.

    One of the whole arm says it of each joint, where the effect hides in every one; and some effects have two names.
    """
    true, (effect, joint) = [name_of(entry) for entry in hidden], finding.name
    if finding.name in true:
        return [finding]
    everywhere = [(effect, str(name)) for name in sequence(answer.get("joints", []))]
    if joint is None and everywhere and all(name in true for name in everywhere):
        return [replace(finding, name=name) for name in everywhere]
    same = [name_of(entry) for entry in hidden if finding.name in other_names(entry)]
    return [replace(finding, name=name, parameters={}, intervals={}) for name in same] or [finding]


def other_names(entry: Mapping[str, object]) -> list[Name]:
    """Return what else an entry of the answer may be called."""
    pairs = [sequence(pair) for pair in sequence(entry.get("equals", []))]
    return [(str(effect), text(joint)) for effect, joint in pairs]


def name_of(entry: Mapping[str, object]) -> Name:
    """Return effect and joint of an entry of the answer."""
    return str(entry["effect"]), text(entry["joint"])


def compare_names(true: Sequence[Name], findings: Sequence[ReportedEffect]) -> dict[str, object]:
    """Return where the names agree and where not."""
    named = [finding.name for finding in findings]
    missing = [name for name in true if name not in named]
    extra = [name for name in named if name not in true]
    wrong = [finding for finding in findings if finding.name not in true]
    beside = {name for finding in findings for name in finding.alternatives}
    return {
        "exact": sorted(map(str, true)) == sorted(map(str, named)),
        "missing": missing,
        "extra": extra,
        "wrong_joint": [name for name in extra if name[0] in {effect for effect, _ in missing}],
        "listed_beside": [name for name in missing if name in beside],
        "abstained": bool(true) and not named,
        "confident_wrong": any(finding.confidence >= CONFIDENT for finding in wrong),
        "confident_wrong_without_the_true_one_beside": any(
            finding.confidence >= CONFIDENT and not set(finding.alternatives) & set(missing) for finding in wrong
        ),
    }


def is_verdict_right(family: str, verdict: object) -> bool:
    """Whether a verdict suits a family; base errors make a retuning right where nothing hides."""
    return verdict in RIGHT_VERDICTS.get(family, frozenset({"explained"}))


def parameter_errors(
    hidden: Sequence[Mapping[str, object]], findings: Sequence[ReportedEffect]
) -> list[dict[str, object]]:
    """Return the error of each parameter of each effect that was named rightly, relative to its true size."""
    by_name = {finding.name: finding for finding in findings}
    rows: list[dict[str, object]] = []
    for entry in hidden:
        finding = by_name.get(name_of(entry))
        true = {key: number(value) for key, value in mapping(entry["parameters"]).items()}
        for key, value in true.items() if finding and finding.parameters else ():
            assert finding is not None
            found = finding.parameters.get(key, 0.0 if key in PLACE else math.nan)
            interval = finding.intervals.get(key)
            rows.append(
                {
                    "effect": entry["effect"],
                    "parameter": key,
                    "relative_error": abs(found - value) / size(str(entry["effect"]), true, key),
                    "covered": None if interval is None else interval[0] <= value <= interval[1],
                }
            )
    return rows


def as_the_model_sees(entry: Mapping[str, object], answer: Mapping[str, object]) -> Mapping[str, object]:
    """Return a hidden effect with a gain that is relative to the model handed over, as the contract has it.

    The plant's own gain is off, too, and no data tells the two factors apart.
    """
    if entry["effect"] != "servo_stiffness":
        return entry
    own = sequence(mapping(answer["base"])["stiffness"])[sequence(answer["joints"]).index(entry["joint"])]
    factor = number(mapping(entry["parameters"])["factor"]) * number(own)
    return {**entry, "parameters": {"factor": factor}}


def size(effect: str, true: Mapping[str, float], key: str) -> float:
    """Return what an error is relative to: a tilt's whole angle, a place's whole distance, for parts may be zero."""
    if effect == "base_tilt":
        return math.hypot(*true.values())
    return math.hypot(*(true[axis] for axis in PLACE if axis in true)) if key in PLACE else abs(true[key])


def joint_named(hidden: Sequence[Mapping[str, object]], report: Mapping[str, object]) -> bool:
    """Whether the joint that shows what cannot be named stands under `unexplained`."""
    joints = {text(entry.get("joint")) for entry in read_list(report.get("unexplained") or [])}
    return any(entry["marked_joint"] in joints for entry in hidden)
