"""Tables of a gap report."""

from collections.abc import Mapping, Sequence

from nas_data.count_of import count_of, join_items
from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import EffectName
from nas_data.gap.report_parts import Bin, JointGap, TriedExperiment
from nas_data.gap.showing.figures import Models
from nas_data.gap.showing.page_words import (
    ANGLE,
    ENDS,
    as_words,
    format_confidence,
    format_effect_title,
    format_figures,
    format_interval,
    format_value,
    format_with_si,
    get_sort_key,
    make_retuned_row,
)
from nas_data.gap.showing.series import Series
from nas_data.joint_units import find_joint_unit
from nas_data.reports.page import Facts, HtmlTable

SHOWN = 3  # most listed conditions per joint
SHOWN_RATIO = 1.2  # ratio of errors inside over outside a condition above which it is listed
MANY = 12  # most episodes whose numbers are listed
NONE = "–"


def make_effects_table(report: GapReport) -> HtmlTable:
    """Return a row for each parameter of each named effect."""
    rows = []
    for effect in report.effects:
        errors = effect.evidence
        shrink = " → ".join(format_value(getattr(errors, end), errors.unit) for end in ENDS)
        equals = join_items([format_effect_title(other) for other in effect.equals]) or NONE
        for name, value in effect.parameters.items():
            values = as_words(name), format_with_si(value.value, value.unit), format_interval(value) or NONE
            remarks = format_confidence(effect.confidence), is_stable(report, effect), equals, shrink
            rows.append((format_effect_title(effect), *values, *remarks))
    headers = ("", "parameter", "value", "95 % interval", "confidence", "stable", "equals", "error without → with")
    return HtmlTable(
        headers,
        rows,
        "Errors on held-out episodes, of the joint that has the effect; of all joints for an effect of the whole arm.",
    )


def is_stable(report: GapReport, effect: EffectName) -> str:
    """Return whether two halves of the recording agree on an effect's joint, or on all joints for the whole arm."""
    stable = [joint.stable for name, joint in report.joints.items() if effect.joint in (None, name)]
    if not stable or None in stable:
        return NONE
    return "yes" if all(stable) else "no"


def make_retuned_table(report: GapReport) -> HtmlTable:
    """Return the retuned parameters, largest change first."""
    rows = [make_retuned_row(entry) for entry in sorted(report.retuned, key=get_sort_key)]
    return HtmlTable(("", "factor", "change"), rows, "Relative to the value in the given model.")


def make_gap_table(series: Series, models: Models) -> HtmlTable:
    """Return the held-out error of each joint and model."""
    errors = {name: series.by_joint(predicted) for name, predicted in models.items()}
    last = list(errors.values())[-1]
    rows = [
        (
            joint,
            *(
                format_value(float(values[place]), find_joint_unit(joint, series.slides).si)
                for values in errors.values()
            ),
            format_value(float(series.floor[place]), find_joint_unit(joint, series.slides).si),
            format_figures(float(last[place] / series.floor[place])),
        )
        for place, joint in enumerate(series.joints)
    ]
    headers = ("", *errors, "noise floor", f"{list(errors)[-1]} / noise")
    return HtmlTable(headers, rows, "Open-loop RMSE of positions, over all held-out episodes.")


def make_joints_table(report: GapReport) -> list[HtmlTable]:
    """Return the gap of the given model beside trivial baselines."""
    found = report.find
    if not found or not found.joints:
        return []
    rows = [make_joint_row(joint, gap) for joint, gap in found.joints.items()]
    headers = ("", "noise", "one step", "(hold)", "open loop", "(hold)", "(command)", "open loop / noise")
    note = (
        "RMSE over the whole recording, with the given model. One step: reset to each measured state. Hold predicts no "
        "motion; command predicts that each joint is at its commanded position."
    )
    return [HtmlTable(headers, rows, note)]


def make_joint_row(joint: str, gap: JointGap) -> tuple[str, ...]:
    """Return the errors of a joint as a row."""
    values = [
        gap.floor, gap.one_step, gap.one_step_hold,
        gap.open_loop, gap.open_loop_hold, gap.open_loop_command,
    ]  # fmt: skip
    cells = [NONE if value is None else format_value(value, gap.unit) for value in values]
    return (joint, *cells, format_figures(gap.ratio_to_noise))


def make_regimes_table(report: GapReport) -> list[HtmlTable]:
    """Return the conditions with significantly larger errors."""
    found = report.find
    units = {joint: gap.unit for joint, gap in found.joints.items()} if found else {}
    rows = [make_condition_row(entry, units) for entry in (select_largest(found.regimes) if found else [])]
    headers = ("", "condition", "error", "otherwise", "share of squared error")
    return [HtmlTable(headers, rows, "Conditions in which the error is significantly larger.")] if rows else []


def select_largest(bins: Sequence[Bin]) -> list[Bin]:
    """Return the significant conditions with the largest errors of each joint."""
    chosen = [b for b in bins if b.significant and b.rmse > SHOWN_RATIO * b.rest]
    joints = dict.fromkeys(b.joint for b in chosen)
    ranked = sorted(chosen, key=lambda b: -b.rmse / max(b.rest, 1e-9))
    return [b for joint in joints for b in [b for b in ranked if b.joint == joint][:SHOWN]]


def make_condition_row(entry: Bin, units: Mapping[str, str]) -> tuple[str, ...]:
    """Return a condition as a row; `units` are those of the joints."""
    condition = f"{entry.regime}: {entry.bin}"
    unit = units.get(entry.joint, ANGLE)
    errors = format_value(entry.rmse, unit), format_value(entry.rest, unit)
    return entry.joint, condition, *errors, f"{100 * entry.share:.0f} %"


def make_audit_facts(report: GapReport) -> list[Facts]:
    """Return the results of the audits."""
    found = report.find
    entries: dict[str, str] = {}
    for check in found.audit if found else []:
        text = ("ok: " if check.ok else "look: ") + check.finding
        entries[check.check] = "; ".join([*([entries[check.check]] if check.check in entries else []), text])
    return [Facts(entries)] if entries else []


def format_separations(entry: TriedExperiment) -> str:
    """Return the difference from each rival [noise floors]."""
    return ", ".join(f"{apart:.1f}" for apart in entry.separations or (entry.separation,))


def make_experiments_table(report: GapReport) -> list[HtmlTable]:
    """Return all experiments that were compared."""
    rows = [
        (
            entry.name,
            ", ".join(entry.on),
            format_value(entry.seconds, "").strip() + " s",
            f"{format_separations(entry)} × noise at {entry.joint}",
        )
        for entry in report.experiments
    ]
    note = (
        "Difference between the predictions of the named effects and of each rival in each experiment, after the rival "
        "was fitted to them; the joint is that of the largest."
    )
    return [HtmlTable(("", "joints", "length", "difference"), rows, note)] if rows else []


def describe_origin(report: GapReport) -> Facts:
    """Return the input of a report, and the command that reproduces it."""
    episodes, source = report.episodes, report.made_from
    entries = {
        "Command": source.command if source else "",
        "Dataset": report.dataset,
        "Content hash": source.content_hash if source else "",
        "Model": report.model,
        "SHA-256 of the model": source.model_sha256 if source else "",
        "Gap": f"{report.gap.metric}",
        "Fitted": format_episodes(episodes.train),
        "Held out": format_episodes(episodes.heldout),
        "Seed": str(report.seed),
        "Time": f"{report.seconds:.0f} s",
        "Versions": ", ".join(f"{name} {version}" for name, version in source.versions.items()) if source else "",
        "In the same folder": "report.json (these numbers), model.xml, model.diff, effects.json, series.npz, figures/",
    }
    return Facts({name: value for name, value in entries.items() if value})


def format_episodes(numbers: Sequence[int]) -> str:
    """Return the number of episodes, and their indices if they are few."""
    which = f": {', '.join(map(str, numbers))}" if 0 < len(numbers) <= MANY else ""
    return f"{count_of(len(numbers), 'episode')}{which}"
