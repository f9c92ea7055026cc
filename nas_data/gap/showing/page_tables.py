"""The tables of a gap report."""

from collections.abc import Mapping, Sequence

from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import Bin, EffectName, JointGap
from nas_data.gap.showing.figures import Models
from nas_data.gap.showing.page_verdict import by_size, change
from nas_data.gap.showing.page_words import (
    ANGLE,
    ENDS,
    beside,
    confidence,
    effect_title,
    figures,
    friendly,
    interval,
    join_items,
    spoken,
)
from nas_data.gap.showing.series import Series
from nas_data.joint_units import joint_unit
from nas_data.reports.page import Facts, HtmlTable

SHOWN = 3  # conditions of a joint that are listed
LARGER = 1.2  # error under a condition over that under the others from which it is listed
MANY = 12  # episodes whose numbers are all listed
NONE = "–"


def effects_table(report: GapReport) -> HtmlTable:
    """Return a row for each parameter of each named effect."""
    rows = []
    for effect in report.effects:
        errors = effect.evidence
        shrink = " → ".join(friendly(getattr(errors, end), errors.unit) for end in ENDS)
        equals = join_items([effect_title(other) for other in effect.equals]) or NONE
        for name, value in effect.parameters.items():
            values = spoken(name), beside(value.value, value.unit), interval(value) or NONE
            told = confidence(effect.confidence), is_stable(report, effect), equals, shrink
            rows.append((effect_title(effect), *values, *told))
    headers = ("", "parameter", "value", "95 % interval", "confidence", "stable", "equals", "error without → with")
    return HtmlTable(
        headers, rows, "Errors on held-out episodes: of the effect's joint, or of all joints of the arm's first kind."
    )


def is_stable(report: GapReport, effect: EffectName) -> str:
    """Say whether two halves of the recording agree on an effect's joint; on all joints for one of the whole arm."""
    told = [joint.stable for name, joint in report.joints.items() if effect.joint in (None, name)]
    return ("yes" if all(told) else "no") if told else NONE


def retuned_table(report: GapReport) -> HtmlTable:
    """Return the changed numbers, the largest change first."""
    rows = [change(entry) for entry in sorted(report.retuned, key=by_size)]
    return HtmlTable(("", "factor", "change"), rows, "Of the value in the model as handed over.")


def gap_table(series: Series, models: Models) -> HtmlTable:
    """Return the held-out error of each joint by each model."""
    errors = {name: series.by_joint(predicted) for name, predicted in models.items()}
    last = list(errors.values())[-1]
    rows = [
        (
            joint,
            *(friendly(float(values[place]), joint_unit(joint, series.slides).si) for values in errors.values()),
            friendly(float(series.floor[place]), joint_unit(joint, series.slides).si),
            figures(float(last[place] / series.floor[place])),
        )
        for place, joint in enumerate(series.joints)
    ]
    headers = ("", *errors, "noise floor", f"{list(errors)[-1]} / noise")
    return HtmlTable(headers, rows, "Open-loop RMSE of positions, over all held-out episodes.")


def joints_table(report: GapReport) -> list[HtmlTable]:
    """Return the gap of the model as handed over beside trivial predictions."""
    found = report.find
    if not found or not found.joints:
        return []
    rows = [joint_row(joint, gap) for joint, gap in found.joints.items()]
    headers = ("", "noise", "one step", "(hold)", "open loop", "(hold)", "(command)", "open loop / noise")
    note = (
        "RMSE over the whole recording, model as handed over. One step: set to every measured state anew. Hold "
        "predicts that nothing moves, command that every joint is where it is told to be."
    )
    return [HtmlTable(headers, rows, note)]


def joint_row(joint: str, gap: JointGap) -> tuple[str, ...]:
    """Return the row of a joint's errors."""
    values = [
        gap.floor, gap.one_step, gap.one_step_hold,
        gap.open_loop, gap.open_loop_hold, gap.open_loop_command,
    ]  # fmt: skip
    told = [NONE if value is None else friendly(value, gap.unit) for value in values]
    return (joint, *told, figures(gap.ratio_to_noise))


def regimes_table(report: GapReport) -> list[HtmlTable]:
    """Return under which conditions a joint's error is larger than otherwise, beyond chance."""
    found = report.find
    units = {joint: gap.unit for joint, gap in found.joints.items()} if found else {}
    rows = [row(entry, units) for entry in (largest(found.regimes) if found else [])]
    headers = ("", "condition", "error", "otherwise", "share of squared error")
    return [HtmlTable(headers, rows, "Where the error is larger, beyond chance.")] if rows else []


def largest(bins: Sequence[Bin]) -> list[Bin]:
    """Return the conditions that stand out, some for each joint."""
    chosen = [b for b in bins if b.significant and b.rmse > LARGER * b.rest]
    joints = dict.fromkeys(b.joint for b in chosen)
    ranked = sorted(chosen, key=lambda b: -b.rmse / max(b.rest, 1e-9))
    return [b for joint in joints for b in [b for b in ranked if b.joint == joint][:SHOWN]]


def row(entry: Bin, units: Mapping[str, str]) -> tuple[str, ...]:
    """Return a row of the table of conditions; `units` are the joints'."""
    condition = f"{entry.regime}: {entry.bin}"
    unit = units.get(entry.joint, ANGLE)
    errors = friendly(entry.rmse, unit), friendly(entry.rest, unit)
    return entry.joint, condition, *errors, f"{100 * entry.share:.0f} %"


def audit_facts(report: GapReport) -> list[Facts]:
    """Return what was looked at in the recording before physics."""
    found = report.find
    entries: dict[str, str] = {}
    for check in found.audit if found else []:
        text = ("ok: " if check.ok else "look: ") + check.finding
        entries[check.check] = "; ".join([*([entries[check.check]] if check.check in entries else []), text])
    return [Facts(entries)] if entries else []


def experiments_table(report: GapReport) -> list[HtmlTable]:
    """Return all experiments that were weighed."""
    rows = [
        (
            entry.name,
            ", ".join(entry.on),
            friendly(entry.seconds, "").strip() + " s",
            f"{entry.separation:.1f} × noise at {entry.joint}",
        )
        for entry in report.experiments
    ]
    note = "Difference of the two best explanations in each experiment, after one was fitted to the other."
    return [HtmlTable(("", "joints", "length", "difference"), rows, note)] if rows else []


def made_from(report: GapReport) -> Facts:
    """Return what the page rests on, and how it is made again."""
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
        "Beside this page": "report.json (these numbers), model.xml, model.diff, effects.json, series.npz, figures/",
    }
    return Facts({name: value for name, value in entries.items() if value})


def format_episodes(numbers: Sequence[int]) -> str:
    """Return how many episodes, and which where they are few."""
    which = f": {', '.join(map(str, numbers))}" if 0 < len(numbers) <= MANY else ""
    return f"{len(numbers)} episode{'' if len(numbers) == 1 else 's'}{which}"
