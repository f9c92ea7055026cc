"""Grading one case: what the report says against the sealed answer."""

import math
from collections.abc import Mapping, Sequence

from nas_data.blind.findings import Finding, Name, listed, mapping, number, read_findings, sequence, text

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
    hidden = listed(answer["effects"])
    outside = answer["family"] == "outside"
    true = [] if outside else [name_of(entry) for entry in hidden]
    findings = read_findings(report)
    named = [finding.name for finding in findings]
    return {
        "true": [name_of(entry) for entry in hidden],
        "named": named,
        "marks": [number(entry["mark"]) for entry in hidden],
        "verdict": report.get("verdict"),
        "verdict_right": is_verdict_right(str(answer["family"]), report.get("verdict")),
        **compared(true, findings),
        "confidences": [{"confidence": finding.confidence, "right": finding.name in true} for finding in findings],
        "parameters": parameter_errors([as_the_model_sees(entry, answer) for entry in hidden], findings),
        "unexplained_joint_named": joint_named(hidden, report) if outside else None,
    }


def name_of(entry: Mapping[str, object]) -> Name:
    """Return effect and joint of an entry of the answer."""
    return str(entry["effect"]), text(entry["joint"])


def compared(true: Sequence[Name], findings: Sequence[Finding]) -> dict[str, object]:
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


def parameter_errors(hidden: Sequence[Mapping[str, object]], findings: Sequence[Finding]) -> list[dict[str, object]]:
    """Return the error of each parameter of each effect that was named rightly, relative to its true size."""
    by_name = {finding.name: finding for finding in findings}
    rows: list[dict[str, object]] = []
    for entry in hidden:
        finding = by_name.get(name_of(entry))
        true = {key: number(value) for key, value in mapping(entry["parameters"]).items()}
        for key, value in true.items() if finding else ():
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
    joints = {text(entry.get("joint")) for entry in listed(report.get("unexplained") or [])}
    return any(entry["marked_joint"] in joints for entry in hidden)
