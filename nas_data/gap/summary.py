"""A gap report in a few lines of text."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from nas_data.joint_units import unit_named

VERDICTS = {
    "none": "No gap above the measurement noise.",
    "retuned": "Nothing is missing: parameters that the model has, changed a little, bring the gap to the noise.",
    "explained": "Explained: what is left is at the measurement noise.",
    "partly_explained": "Partly explained: a rest above the noise remains.",
    "unexplained": "Unexplained: no effect in the catalogue accounts for the gap.",
}


DELIVERED = {
    "names and plain": "model.xml holds the names and all that the plain fit changes: the names alone predict worse.",
    "plain": "model.xml is the plain fit, without names: it predicts held-out episodes better than any names.",
    "given": "model.xml is the model as given: nothing that was fitted predicts held-out episodes better.",
}


def summary(report: Mapping[str, object], folder: Path) -> str:
    """Return what a person wants to read first."""
    gap = mapping(report["gap"])
    lines = [VERDICTS[str(report["verdict"])]]
    undecidable = mapping(report["find"]).get("undecidable")
    lines += map(str, undecidable) if isinstance(undecidable, Sequence) else []
    audit = mappings(mapping(report["find"]).get("audit", []))
    lines += [str(check["finding"]) for check in audit if check["check"] == "model" and not check["ok"]]
    lines += [finding_text(entry) for entry in mappings(report["effects"])]
    lines += [
        f"{entry['joint']}: still {number(entry['ratio_to_noise']):.1f} times the noise; goes with {entry['goes_with']}"
        for entry in mappings(report["unexplained"])
    ]
    changed = [
        f"{entry['parameter']} × {number(entry['factor']):.3f}{' (on its bound)' if entry.get('at_bound') else ''}"
        for entry in mappings(report["retuned"])
    ]
    if changed:
        lines.append("retuned: " + ", ".join(changed))
    slides = mapping(gap.get("slides", {}))
    beside = f" of the hinges, {shrinking(slides)} of the slides" if slides else ""
    lines.append(
        f"open-loop error on held-out episodes: {shrinking(gap)}{beside}, in {number(report['seconds']):.0f} s"
    )
    if (delivered := str(gap.get("delivered"))) in DELIVERED:
        lines.append(DELIVERED[delivered])
    if report.get("next_experiment"):
        lines.append(f"record next: {report['next_experiment']}")
    if (folder / "phi").is_dir() and not mapping(report["shares"]).get("learned"):
        lines.append(f"{folder / 'phi'} is what an earlier report learned on top; --learn replaces it")
    return "\n".join([*lines, f"{folder / 'report.html'}", f"{folder / 'model.xml'}"])


def shrinking(gap: Mapping[str, object]) -> str:
    """Return how an error shrinks, beside what limits it."""
    unit = unit_named(str(gap.get("unit")))
    before, after, floor = (unit.text(number(gap[name])) for name in ("before", "after", "noise_floor"))
    plain = f"plain fit {unit.text(number(gap['plain']))}, " if "plain" in gap else ""
    return f"{before} → {after} ({plain}noise floor {floor})"


def finding_text(entry: Mapping[str, object]) -> str:
    """Return a finding in a line."""
    where = entry["joint"] or "whole arm"
    values = ", ".join(value_text(name, mapping(value)) for name, value in mapping(entry["parameters"]).items())
    evidence = mapping(entry["evidence"])
    unit = unit_named(str(evidence.get("unit")))
    before, after = (unit.text(number(evidence[f"heldout_error_{when}"])) for when in ("before", "after"))
    line = (
        f"{where}: {entry['effect']} {values}; confidence {number(entry['confidence']):.2f}; error {before} → {after}"
    )
    second = next(iter(mappings(entry["alternatives"])), None)
    equals = [f"{other['effect']} {other['joint'] or ''}".strip() for other in mappings(entry.get("equals", []))]
    if equals:
        line += f" (these data cannot tell it from {', '.join(equals)})"
    elif second:
        line += f" (runner-up {second['effect']}: {unit.text(number(second['heldout_error_after']))})"
    return line


def value_text(name: str, value: Mapping[str, object]) -> str:
    """Return a parameter with its interval."""
    low, high = (number(end) for end in value["interval95"])  # type: ignore[attr-defined]
    return f"{name} {number(value['value']):.4g} {value['unit']} [{low:.4g}, {high:.4g}]".replace("  ", " ")


def number(value: object) -> float:
    """Take a JSON value as a number."""
    return float(value)  # type: ignore[arg-type]


def mapping(value: object) -> Mapping[str, object]:
    """Take a JSON value as an object."""
    assert isinstance(value, Mapping)
    return value


def mappings(value: object) -> Sequence[Mapping[str, object]]:
    """Take a JSON value as a list of objects."""
    assert isinstance(value, Sequence)
    return [mapping(item) for item in value]
