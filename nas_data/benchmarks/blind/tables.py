"""Tables of the blind benchmark: rates by family and plant, confusions, reliability of confidence, power."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from nas_data.benchmarks.blind.findings import read_mapping, read_number
from nas_data.benchmarks.blind.run_case import Record

CONFIDENCES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
MARKS = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
NOTHING = "nothing"
PERCENT = ("exact", "confident_wrong", "abstained", "verdict_right", "covered", "unexplained_joint_named")
TITLES = {
    "families": "Families (before, rest: median error on fresh episodes / noise floor; least: with the answer)",
    "confusions": "What was named where one effect hides, or none",
    "reliability": "Is the confidence true?",
    "power": "Found by size of the mark [noise floors]",
    "baselines": "Baselines on the same cases",
}
SHORT = {
    "confident_wrong": "conf. wrong", "verdict_right": "verdict ok", "rest_over_floor": "rest",
    "least_over_floor": "least",
    "before_over_floor": "before", "parameter_error": "param. error", "unexplained_joint_named": "joint of rest",
    "seconds": "s",
}  # fmt: skip

Row = dict[str, object]


def make_tables(records: Sequence[Record]) -> dict[str, list[Row]]:
    """Return every table of finished cases as rows.

    Args:
        records: One a case, as `judge` stores them.
    """
    named = [record for record in records if "fault" not in record]
    result = {
        "families": [summarise_family(*group) for group in group_by_family(records)],
        "confusions": count_confusions(named),
        "reliability": compute_reliability(named),
        "power": compute_power(named),
    }
    return result | {"baselines": summarise_baselines(records)}


def group_by_family(records: Sequence[Record]) -> Iterable[tuple[str, str, list[Record]]]:
    """Group by family and plant, in the order in which they first appear."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((str(record["family"]), str(record["plant"])), []).append(record)
    return [(family, plant, group) for (family, plant), group in groups.items()]


def summarise_family(family: str, plant: str, records: Sequence[Record]) -> Row:
    """Summarise one family on one plant; what failed is wrong, but not confidently so."""
    done = [record for record in records if "fault" not in record]
    errors = [entry for record in done for entry in read_list(record["parameters"])]
    return {
        "family": family,
        "plant": plant,
        "cases": len(records),
        "failed": len(records) - len(done),
        "exact": compute_share(record.get("exact") for record in records),
        "confident_wrong": compute_share(record.get("confident_wrong", False) for record in records),
        "abstained": compute_share(record.get("abstained", False) for record in records),
        "verdict_right": compute_share(record.get("verdict_right", False) for record in records),
        "verdicts": dict(Counter(str(record["verdict"]) for record in records)),
        "rest_over_floor": median(compute_rest(record) for record in done),
        "least_over_floor": median(
            compute_rest(record, "least") for record in done if read_mapping(record["fresh"]).get("least")
        ),
        "before_over_floor": median(compute_rest(record, "before") for record in done),
        "parameter_error": median(read_number(entry["relative_error"]) for entry in errors),
        "covered": compute_share(entry["covered"] for entry in errors if entry["covered"] is not None),
        "unexplained_joint_named": compute_share(
            record["unexplained_joint_named"] for record in done if record["unexplained_joint_named"] is not None
        ),
        "seconds": median(read_number(record["seconds"]) for record in done),
    }


def compute_rest(record: Record, key: str = "after") -> float:
    """Return the error on fresh episodes as a multiple of the floor; infinite where the model was of no use."""
    fresh = read_mapping(record["fresh"])
    return read_number(fresh.get(key), np.inf) / read_number(fresh["floor"])


def compute_share(values: Iterable[object]) -> float | None:
    """Return the share of true values; None of none."""
    flags = [bool(value) for value in values]
    return sum(flags) / len(flags) if flags else None


def median(values: Iterable[float]) -> float | None:
    """Return the median; None of none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.median(known)) if known else None


def count_confusions(records: Sequence[Record]) -> list[Row]:
    """Count, for cases that hide one effect, what was named: effects by name, joints aside."""
    rows: dict[str, Counter[str]] = {}
    for record in records:
        true, named = read_sequence(record["true"]), read_sequence(record["named"])
        if len(true) > 1:
            continue
        row = rows.setdefault(read_effect(true[0]) if true else NOTHING, Counter())
        row.update([read_effect(name) for name in named] or [NOTHING])
    return [{"true": effect, "named": dict(rows[effect].most_common())} for effect in sorted(rows)]


def read_effect(name: object) -> str:
    """Return the effect of a stored name, a list of effect and joint."""
    return str(read_sequence(name)[0])


def compute_reliability(records: Sequence[Record]) -> list[Row]:
    """Compare the confidence of findings with how often they were right."""
    findings = [entry for record in records for entry in read_list(record["confidences"])]
    known = [(read_number(entry["confidence"]), bool(entry["right"])) for entry in findings]
    rows: list[Row] = []
    for low, high in pairwise(CONFIDENCES):
        inside = [pair for pair in known if low <= pair[0] < high or (high == 1.0 and pair[0] == 1.0)]
        if inside:
            said, right = (float(np.mean(values)) for values in zip(*inside, strict=True))
            rows.append({"from": low, "to": high, "findings": len(inside), "confidence": said, "right": right})
    return rows


def compute_power(records: Sequence[Record]) -> list[Row]:
    """Return how often single effects were found by how much they show, as multiples of the noise floor."""
    single = [record for record in records if len(read_sequence(record["true"])) == 1 and record["family"] != "outside"]
    seen = [(read_number(read_sequence(record["marks"])[0]), record) for record in single]
    rows: list[Row] = []
    for low, high in pairwise((*MARKS, np.inf)):
        inside = [record for mark, record in seen if low <= mark < high]
        if inside:
            row: Row = {"from": low, "to": high, "cases": len(inside)}
            for key in ("exact", "confident_wrong", "abstained"):
                row[key] = compute_share(record[key] for record in inside)
            rows.append(row)
    return rows


def summarise_baselines(records: Sequence[Record]) -> list[Row]:
    """Summarise the baselines by family, over all plants, beside the workflow's own rest."""
    rows: list[Row] = []
    names = dict.fromkeys(name for record in records for name in read_mapping(record.get("baselines", {})))
    for name in names:
        for family in dict.fromkeys(str(record["family"]) for record in records):
            answers = [
                read_mapping(read_mapping(record["baselines"])[name])
                for record in records
                if record["family"] == family and name in read_mapping(record.get("baselines", {}))
            ]
            rows.append(summarise_baseline(name, family, answers))
    return rows


def summarise_baseline(name: str, family: str, answers: Sequence[Mapping[str, object]]) -> Row:
    """Summarise one baseline on one family."""
    done = [dict(answer) for answer in answers if "fault" not in answer]
    return {
        "baseline": name,
        "family": family,
        "cases": len(answers),
        "failed": len(answers) - len(done),
        "exact": compute_share(answer.get("exact") for answer in answers),
        "confident_wrong": compute_share(answer.get("confident_wrong", False) for answer in answers),
        "rest_over_floor": median(compute_rest(answer) for answer in done),
        "seconds": median(read_number(answer["seconds"]) for answer in done),
    }


def read_sequence(value: object) -> Sequence[object]:
    """Return a JSON list."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"a list is needed, given {value!r}")
    return value


def read_list(value: object) -> list[Mapping[str, object]]:
    """Return a JSON list of objects."""
    return [read_mapping(item) for item in read_sequence(value)]


def print_tables(found: Mapping[str, Sequence[Row]]) -> str:
    """Return all tables that have rows, with their titles."""
    return "\n\n".join(f"{TITLES[name]}\n{align_columns(rows)}" for name, rows in found.items() if rows)


def align_columns(rows: Sequence[Row]) -> str:
    """Return rows of the same keys as columns; the words left, the numbers right."""
    keys = list(rows[0])
    cells = [[SHORT.get(key, key) for key in keys], *([format_cell(key, row[key]) for key in keys] for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(keys))]
    worded = [isinstance(rows[0][key], str | Mapping) for key in keys]
    lines = [
        "  ".join(
            f"{word:<{width}}" if left else f"{word:>{width}}"
            for word, width, left in zip(line, widths, worded, strict=True)
        ).rstrip()
        for line in cells
    ]
    return "\n".join(lines)


def format_cell(key: str, value: object) -> str:
    """Return one value as a person reads it."""
    if value is None:
        return "–"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in read_mapping(value).items())
    if isinstance(value, str | int):
        return str(value)
    if key in PERCENT or key == "right":
        return f"{read_number(value):.0%}"
    return f"{read_number(value):.3g}"
