"""Gather finished blind cases into one file beside the tables of blind.md, and print those tables from it."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import tyro

FAMILIES = {
    "one": "one effect",
    "two": "two effects",
    "three": "three effects",
    "none": "nothing hidden",
    "outside": "outside the catalogue",
}
KEPT = (
    "case", "arm", "excitation", "true", "marks", "named", "confidences", "parameters", "verdict", "exact",
    "confident_wrong", "unexplained_joint_named", "seconds", "fresh", "baselines",
)  # fmt: skip
SURE = 0.8  # a wrong name with at least this confidence counts as confidently wrong
Case = Mapping[str, object]


def gathered(folders: Iterable[Path], commit: str, seed: int, before: Path | None) -> dict[str, object]:
    """Return the finished cases of some `--out` folders, after those of an earlier file."""
    cases = {case["case"]: case for case in (json.loads(before.read_text("utf-8"))["cases"] if before else ())}
    for folder in folders:
        for path in sorted((folder / "results").glob("*.json")):
            record = json.loads(path.read_text("utf-8"))
            cases[record["case"]] = {key: record[key] for key in KEPT if record.get(key) != {}}
    return {"commit": commit, "seed": seed, "cases": [cases[name] for name in sorted(cases)]}


def write(path: Path, whole: Mapping[str, object]) -> None:
    """Write the file, one case a line."""
    lines = ",\n".join(json.dumps(case) for case in whole["cases"])
    head = f'{{"commit": {json.dumps(whole["commit"])}, "seed": {whole["seed"]}, "cases": ['
    path.write_text(f"{head}\n{lines}\n]}}\n", encoding="utf-8")


def family_of(case: Case) -> str:
    """Return the family that a case's name begins with."""
    return str(case["case"]).removeprefix("any-").split("-")[0]


def row(family: str, cases: Sequence[Case]) -> str:
    """Return one line of the table of families."""
    right = [case for case in cases if case["exact"]]
    sure = sum(any(said["confidence"] >= SURE and not said["right"] for said in case["confidences"]) for case in cases)
    least = [case["fresh"]["least"] / case["fresh"]["floor"] for case in right if case["fresh"].get("least")]
    told = [str(len(right)), str(sure), median(rests(right)), median(least)]
    if family == "outside":
        named = sum(bool(case["unexplained_joint_named"]) for case in cases)
        explained = sum(case["verdict"] == "explained" for case in cases)
        told[0] = f"named nothing in {len(right)}"
        told[2:] = [f"({explained} `explained`, the joint among the unexplained in {named})", ""]
    return f"| {FAMILIES[family]} | {len(cases)} | {' | '.join(told)} |"


def rests(cases: Iterable[Case]) -> list[float]:
    """Return what the delivered models leave on fresh episodes, as multiples of the noise floor."""
    return [case["fresh"]["after"] / case["fresh"]["floor"] for case in cases if case["fresh"].get("after")]


def median(values: Sequence[float]) -> str:
    """Return the median with two digits; nothing of none."""
    return f"{np.median(values):.2f}" if values else ""


def told(cases: Sequence[Case]) -> str:
    """Return table and list as Markdown."""
    by_family = {family: [case for case in cases if family_of(case) == family] for family in FAMILIES}
    lines = ["| family | cases | exactly right | wrong with confidence ≥ 0.8 | rest | least |", "|" + " --- |" * 6]
    lines += [row(family, own) for family, own in by_family.items() if own]
    parameters = [entry for case in cases for entry in case["parameters"]]
    errors = [entry["relative_error"] for entry in parameters if not np.isnan(entry["relative_error"])]
    judged = [bool(entry["covered"]) for entry in parameters if entry["covered"] is not None]
    said = [(entry["confidence"], entry["right"]) for case in cases for entry in case["confidences"]]
    lines += ["", f"- parameters: median error {np.median(errors):.1%}, largest {max(errors):.0%}; "]
    lines[-1] += f"intervals held the truth in {sum(judged)} of {len(judged)}"
    for low, high in ((0.8, 2.0), (0.5, 0.8), (0.0, 0.5)):
        inside = [right for confidence, right in said if low <= confidence < high]
        lines.append(f"- confidence from {low}: {sum(inside)} of {len(inside)} findings right")
    own = [case for family in ("one", "two", "three") for case in by_family[family] if case["exact"]]
    lines.append(f"- rest of all right ones: {median(rests(own))} floors")
    for family, members in by_family.items():
        lines.append(f"- {family}: {median([case['seconds'] for case in members])} s")
    lines += [f"- not right: {case['case']}: {names(case)}" for case in cases if wrong(case)]
    return "\n".join([*lines, *baselines(by_family)])


def baselines(by_family: Mapping[str, Sequence[Case]]) -> list[str]:
    """Return a table of the other methods on the cases that they were given, the workflow's own figures beside them."""
    lines = ["", "| family | method | cases | exactly right | wrong, sure | rest | s |", "|" + " --- |" * 7]
    for family, members in by_family.items():
        both = [case for case in members if case.get("baselines")]
        methods = {"nas gap": both} | {
            name: [case["baselines"][name] for case in both if name in case["baselines"]]
            for name in dict.fromkeys(name for case in both for name in case["baselines"])
        }
        lines += [method_row(FAMILIES[family], name, answers) for name, answers in methods.items() if answers]
    return lines if len(lines) > 3 else []


def method_row(family: str, name: str, answers: Sequence[Case]) -> str:
    """Return one line of that table; rests are those of all cases, right or not."""
    right = sum(bool(answer["exact"]) for answer in answers)
    sure = sum(bool(answer["confident_wrong"]) for answer in answers if "confident_wrong" in answer)
    seconds = median([answer["seconds"] for answer in answers if "seconds" in answer])
    left = median([rest for answer in answers if "fresh" in answer for rest in rests([answer])])
    return f"| {family} | {name} | {len(answers)} | {right} | {sure} | {left} | {seconds} |"


def wrong(case: Case) -> bool:
    """Return whether a case inside the catalogue was not named exactly."""
    return not case["exact"] and family_of(case) != "outside"


def names(case: Case) -> str:
    """Return what was hidden and what was named, with confidences."""
    named = [
        f"{words(name)} {said['confidence']:.2f}" for name, said in zip(case["named"], case["confidences"], strict=True)
    ]
    marks = [f"{words(name)} ({mark:.0f} floors)" for name, mark in zip(case["true"], case["marks"], strict=True)]
    return f"{', '.join(marks)} → {', '.join(named) or 'nothing'}"


def words(name: Sequence[str | None]) -> str:
    """Return effect and joint."""
    return " ".join(part for part in name if part)


def main(
    file: tyro.conf.Positional[Path],
    folders: tyro.conf.Positional[tuple[Path, ...]] = (),
    commit: str = "",
    seed: int = 0,
) -> None:
    """Print the tables of a file of blind cases, after the cases of some folders have been added to it.

    Args:
        file: JSON beside blind.md.
        folders: `--out` folders of `nas benchmark gap`, whose finished cases are added first.
        commit: What the added cases were run with.
        seed: Seed that they were drawn with.
    """
    if folders:
        write(file, gathered(folders, commit, seed, file if file.exists() else None))
    print(told(json.loads(file.read_text("utf-8"))["cases"]))


if __name__ == "__main__":
    tyro.cli(main)
