"""The tables of the blind benchmark as text."""

from collections.abc import Mapping, Sequence

from nas_data.benchmarks.blind.findings import mapping, number
from nas_data.benchmarks.blind.tables import Row

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


def print_tables(found: Mapping[str, Sequence[Row]]) -> str:
    """Return all tables that have rows, with their titles."""
    return "\n\n".join(f"{TITLES[name]}\n{align_columns(rows)}" for name, rows in found.items() if rows)


def align_columns(rows: Sequence[Row]) -> str:
    """Return rows of the same keys as columns; the words left, the numbers right."""
    keys = list(rows[0])
    cells = [[SHORT.get(key, key) for key in keys], *([cell(key, row[key]) for key in keys] for row in rows)]
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


def cell(key: str, value: object) -> str:
    """Return one value as a person reads it."""
    if value is None:
        return "–"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in mapping(value).items())
    if isinstance(value, str | int):
        return str(value)
    if key in PERCENT or key == "right":
        return f"{number(value):.0%}"
    return f"{number(value):.3g}"
