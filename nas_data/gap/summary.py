"""Text summary of a gap report."""

import math
from pathlib import Path

from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import FittedParameter, NamedEffect
from nas_data.gap.report_parts import GapErrors, LearnedCorrection, Unexplained
from nas_data.joint_units import find_display_unit

VERDICTS = {
    "none": "No gap above the measurement noise.",
    "retuned": "Nothing is missing: small changes of the model's own parameters reduce the gap to the noise.",
    "explained": "Explained: the remaining error is at the measurement noise.",
    "partly_explained": "Partly explained: an error above the noise remains.",
    "unexplained": "Unexplained: no effect in the catalogue accounts for the gap.",
}

RETUNED_FAR = (
    "Unexplained: no effect in the catalogue accounts for the gap, but parameters that the model has reduce it to the "
    "noise, changed by more than 25 %."
)
LARGEST_CONDITION_NUMBER = 1e6  # above which the data do not determine all parameters
UNDECIDED = "Unexplained: this recording does not decide which effect is missing."
IN_MOTION = (
    "The error is above the noise floor because episodes begin in motion, "
    "in states that are estimated from noisy readings."
)
MAX_OVER_FLOOR = 3.0  # noise floors of the pooled error, above which an explained gap needs that sentence
MOST_RETUNED = 6  # most base parameters listed, those that changed most
DELIVERED = {
    "names and plain": "model.xml has the named effects and all changes of the plain fit: with the named effects only, "
    "it predicts worse.",
    "names of MJCF and plain": "model.xml has the plain fit in place of the named effects that MJCF cannot express "
    "(effects.json has them).",
    "plain": "model.xml is the plain fit, without named effects: a file with them predicts held-out episodes worse. "
    "model.diff lists its changes.",
    "given": "model.xml is the model as given: no fitted model predicts held-out episodes better.",
}


def summarise(report: GapReport, folder: Path) -> str:
    """Return the main results of a report and the paths of its files."""
    lines = list_findings(report)
    if (folder / "phi").is_dir() and not (report.shares and report.shares.learned):
        lines.append(f"{folder / 'phi'} is the φ of an earlier report; --learn replaces it")
    return "\n".join([*lines, f"{folder / 'report.html'}", f"{folder / 'model.xml'}"])


def list_findings(report: GapReport) -> list[str]:
    """Return verdict, names, remaining errors and next experiment, a line each."""
    gap, found = report.gap, report.find
    lines = [describe_verdict(report)]
    if found:
        lines += found.undecidable
        lines += [check.finding for check in found.audit if check.check == "model" and not check.ok]
    lines += map(describe_effect, report.effects)
    lines += map(describe_open_joint, report.unexplained)
    by_change = sorted(report.retuned, key=lambda entry: (not entry.at_bound, -abs(math.log(entry.factor))))
    changed = [
        f"{entry.parameter} × {entry.factor:.3f}{' (at its bound)' if entry.at_bound else ''}"
        for entry in by_change[:MOST_RETUNED]
    ]
    if changed:
        more = len(by_change) - len(changed)
        lines.append("retuned: " + ", ".join(changed) + (f", and {more} more, in report.html" if more else ""))
    beside = f" of the hinges, {describe_errors(gap.slides)} of the slides" if gap.slides else ""
    errors = f"{describe_errors(gap)}{beside}"
    lines.append(f"open-loop error on held-out episodes{gap.less}: {errors}, in {report.seconds:.0f} s")
    if report.phi:
        lines.append(describe_learned(report.phi))
    if is_from_initial_states(report):
        lines.append(IN_MOTION)
    if undetermined := describe_conditioning(report):
        lines.append(undetermined)
    if gap.delivered in DELIVERED:
        lines.append(DELIVERED[gap.delivered])
    if report.next_experiment:
        lines.append(f"record next: {report.next_experiment}")
    return lines


def is_from_initial_states(report: GapReport) -> bool:
    """Return whether the rest of an explained gap comes from estimated initial states."""
    gap = report.gap
    is_explained = report.verdict not in ("partly_explained", "unexplained")
    error = gap.before if report.verdict == "none" else gap.after
    is_large = gap.noise_floor is not None and error > MAX_OVER_FLOOR * gap.noise_floor
    return report.episodes.begin_in_motion and is_explained and is_large


def describe_verdict(report: GapReport) -> str:
    """Return the verdict as a sentence."""
    if is_retuned_far(report):
        return RETUNED_FAR
    if report.verdict == "unexplained" and (report.experiments or not report.unexplained):
        return UNDECIDED
    return VERDICTS.get(report.verdict, f"Verdict: {report.verdict}.")


def is_retuned_far(report: GapReport) -> bool:
    """Return whether large changes of parameters reduce the gap of an unexplained report to the noise."""
    return bool(report.unexplained) and all(entry.is_at_floor for entry in report.unexplained)


def describe_open_joint(entry: Unexplained) -> str:
    """Return what is unexplained in a joint on one line."""
    if entry.is_at_floor:
        return (
            f"{entry.joint}: at the noise with a large change of {entry.goes_with} only; check its value in the model"
        )
    return f"{entry.joint}: still {entry.ratio_to_noise:.1f} times the noise; correlates with {entry.goes_with}"


def describe_conditioning(report: GapReport) -> str:
    """Return a sentence about a fit that the data do not determine, empty for others."""
    number = report.conditioning
    if number is None or number <= LARGEST_CONDITION_NUMBER:
        return ""
    return (
        f"The data do not determine all parameters (condition number {number:.0e}): some of them can change together "
        "and predict the same."
    )


def describe_errors(gap: GapErrors) -> str:
    """Return the error before and after, beside plain fit and noise floor."""
    unit = find_display_unit(gap.unit)
    plain = "" if gap.plain is None else f"plain fit {unit.text(gap.plain)}, "
    floor = "unknown" if gap.noise_floor is None else unit.text(gap.noise_floor)
    return f"{unit.text(gap.before)} → {unit.text(gap.after)} ({plain}noise floor {floor})"


def describe_learned(phi: LearnedCorrection) -> str:
    """Return a sentence on the errors without and with φ, and on whether it is left out."""
    unit = find_display_unit(phi.unit)
    without = unit.text(phi.written)
    if phi.helps and phi.corrected is not None:
        return f"φ reduces the error on held-out episodes: {without} → {unit.text(phi.corrected)}"
    found = "it diverges" if phi.corrected is None else f"the error is {unit.text(phi.corrected)} with it"
    return f"φ is left out, as it does not help: on held-out episodes {found}, {without} without it"


def describe_effect(effect: NamedEffect) -> str:
    """Return a named effect on one line."""
    values = ", ".join(describe_parameter(name, value) for name, value in effect.parameters.items())
    errors = effect.evidence
    unit = find_display_unit(errors.unit)
    before, after = unit.text(errors.heldout_error_before), unit.text(errors.heldout_error_after)
    line = (
        f"{effect.joint or 'whole arm'}: {effect.name} {values}; confidence {effect.confidence:.2f}; "
        f"error {before} → {after}"
    )
    if effect.equals:
        equals = [f"{other.name} {other.joint or ''}".strip() for other in effect.equals]
        line += f" (these data cannot distinguish it from {', '.join(equals)})"
    elif effect.alternatives:
        second = effect.alternatives[0]
        rival = second.name
        if second.joint != effect.joint:  # the same name at another place is another explanation
            rival += f" {second.joint}" if second.joint else " of the whole arm"
        line += f" (runner-up {rival}: {unit.text(second.heldout_error_after)})"
    if errors.contradicts_constant:
        line += "; the error that remains depends on the position, so it may not be constant"
    return line


def describe_parameter(name: str, parameter: FittedParameter) -> str:
    """Return a parameter with its interval."""
    text = f"{name} {parameter.value:.4g} {parameter.unit}".rstrip()
    if parameter.interval95:
        low, high = parameter.interval95
        text += f" [{low:.4g}, {high:.4g}]"
    if parameter.episode_range:
        least, most = parameter.episode_range
        text += f", from {least:.3g} to {most:.3g} in single episodes"
    return text
