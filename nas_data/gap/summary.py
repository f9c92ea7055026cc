"""A gap report in a few lines of text."""

from pathlib import Path

from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import FittedParameter, GapErrors, NamedEffect
from nas_data.joint_units import display_unit

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


def summary(report: GapReport, folder: Path) -> str:
    """Return what a person wants to read first, and where the report lies."""
    lines = findings(report)
    if (folder / "phi").is_dir() and not (report.shares and report.shares.learned):
        lines.append(f"{folder / 'phi'} is what an earlier report learned on top; --learn replaces it")
    return "\n".join([*lines, f"{folder / 'report.html'}", f"{folder / 'model.xml'}"])


def findings(report: GapReport) -> list[str]:
    """Return verdict, names, what stays and what to record next, a line each."""
    gap, found = report.gap, report.find
    lines = [VERDICTS.get(report.verdict, f"Verdict: {report.verdict}.")]
    if found:
        lines += found.undecidable
        lines += [check.finding for check in found.audit if check.check == "model" and not check.ok]
    lines += map(finding_text, report.effects)
    lines += [
        f"{entry.joint}: still {entry.ratio_to_noise:.1f} times the noise; goes with {entry.goes_with}"
        for entry in report.unexplained
    ]
    changed = [
        f"{entry.parameter} × {entry.factor:.3f}{' (on its bound)' if entry.at_bound else ''}"
        for entry in report.retuned
    ]
    if changed:
        lines.append("retuned: " + ", ".join(changed))
    beside = f" of the hinges, {shrinking(gap.slides)} of the slides" if gap.slides else ""
    lines.append(f"open-loop error on held-out episodes: {shrinking(gap)}{beside}, in {report.seconds:.0f} s")
    if gap.delivered in DELIVERED:
        lines.append(DELIVERED[gap.delivered])
    if report.next_experiment:
        lines.append(f"record next: {report.next_experiment}")
    return lines


def shrinking(gap: GapErrors) -> str:
    """Return how an error shrinks, beside what limits it."""
    unit = display_unit(gap.unit)
    plain = "" if gap.plain is None else f"plain fit {unit.text(gap.plain)}, "
    floor = "unknown" if gap.noise_floor is None else unit.text(gap.noise_floor)
    return f"{unit.text(gap.before)} → {unit.text(gap.after)} ({plain}noise floor {floor})"


def finding_text(effect: NamedEffect) -> str:
    """Return a finding in a line."""
    values = ", ".join(value_text(name, value) for name, value in effect.parameters.items())
    errors = effect.evidence
    unit = display_unit(errors.unit)
    before, after = unit.text(errors.heldout_error_before), unit.text(errors.heldout_error_after)
    line = (
        f"{effect.joint or 'whole arm'}: {effect.name} {values}; confidence {effect.confidence:.2f}; "
        f"error {before} → {after}"
    )
    if effect.equals:
        equals = [f"{other.name} {other.joint or ''}".strip() for other in effect.equals]
        line += f" (these data cannot tell it from {', '.join(equals)})"
    elif effect.alternatives:
        second = effect.alternatives[0]
        line += f" (runner-up {second.name}: {unit.text(second.heldout_error_after)})"
    return line


def value_text(name: str, parameter: FittedParameter) -> str:
    """Return a parameter with its interval."""
    low, high = parameter.interval95 or (parameter.value, parameter.value)
    return f"{name} {parameter.value:.4g} {parameter.unit} [{low:.4g}, {high:.4g}]".replace("  ", " ")
