"""HTML page of a gap report, and the files of page and figures."""

from pathlib import Path

import numpy as np

from nas_data.atomic_file import make_file_names, write_atomic
from nas_data.count_of import join_items
from nas_data.gap.report import REPORT, GapReport
from nas_data.gap.report_effects import NamedEffect
from nas_data.gap.showing import page_charts as charts
from nas_data.gap.showing import page_tables as tables
from nas_data.gap.showing.figures import draw_all_joints, draw_joint, find_joints_above, select_models
from nas_data.gap.showing.film import make_film_blocks
from nas_data.gap.showing.page_words import (
    as_words,
    capitalise,
    describe_model,
    describe_rest,
    describe_score_basis,
    describe_slides,
    describe_verdict,
    format_effect_title,
    format_error,
    format_value,
    format_with_si,
    list_remarks,
)
from nas_data.gap.showing.series import Series
from nas_data.gap.summary import DELIVERED, describe_conditioning, describe_learned
from nas_data.gap.write_model import DIFFERENCE
from nas_data.reports.page import Block, HtmlPage, ModelDifference, PageSection, Text
from nas_data.reports.style import to_png

READING = (
    "Gap: every held-out episode is simulated from its first pose with the recorded commands alone (open loop). The "
    "result is compared with the measured positions. No parameter was fitted to these episodes, but they decided which "
    "effects were kept.",
    "Noise floor: the error that rounding and noise of the readings leave, or 0.03 % of the joint's travel if that is "
    "more. A model can be below it where the readings are finer.",
    "Confidence: probability that effect and joint are right. Of names with 90 %, nine in ten should be right.",
    "Interval: 95 % interval of the parameter, if the name is right.",
    "Stable: whether two halves of the recording agree on the joint's parameters.",
    "Equals: effects that these data cannot distinguish from the named one. The cause is one of them.",
    "Retuned: masses, gains, damping, rotor inertia and friction of a real arm are some percent off its model. They "
    "were free within ±25 % throughout, so that no effect is named for what they explain.",
)
SIDES = (
    "Both models as MuJoCo saves them, with numbers rounded to six digits, so that only real changes appear. model.xml "
    "in "
    "the report's folder is the whole model with the changes."
)
NOT_WRITTEN = "MJCF cannot express {} exactly: effects.json has the exact effect, model.xml the nearest one."


def read_page(folder: Path) -> HtmlPage:
    """Return the page of a report's folder.

    Raises:
        OptionError: `report.json` or `series.npz` is missing or incomplete.
    """
    return build_page(GapReport.read(folder / REPORT), Series.read(folder), folder)


def build_page(report: GapReport, series: Series, folder: Path) -> HtmlPage:
    """Return the page; model difference and film are included if their files exist."""
    slides = describe_slides(report)
    sections = [
        PageSection("", [Text(describe_verdict(report), lead=True), *([Text(slides)] if slides else [])]),
        PageSection("Changes of the model", make_change_blocks(report, folder)),
        PageSection("How the gap shrinks", make_error_blocks(report, series)),
        PageSection("Where the gap is largest", make_place_blocks(report)),
        PageSection("The names", make_effects_blocks(report)),
        PageSection("Measured, before and after", make_motion_blocks(report, series, folder)),
        PageSection("A wrong name in its place", make_placebo_blocks(report, series)),
        PageSection("What remains unexplained", make_unexplained_blocks(report)),
        PageSection("What to record next", make_next_experiment_blocks(report)),
        PageSection("The recording", tables.make_audit_facts(report)),
        PageSection("Commands, hashes and versions", [tables.describe_origin(report)]),
        PageSection("How to read this page", [Text(line) for line in (*READING, describe_score_basis(report))]),
    ]
    return HtmlPage(f"Gap report of {describe_model(report)}", [section for section in sections if section.blocks])


def make_place_blocks(report: GapReport) -> list[Block]:
    """Return the errors by joint and condition."""
    return [*charts.draw_regimes_chart(report), *tables.make_joints_table(report), *tables.make_regimes_table(report)]


def make_change_blocks(report: GapReport, folder: Path) -> list[Block]:
    """Return the changes of the model: difference, added effects, and retuned parameters."""
    file = folder / DIFFERENCE
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    missing = [format_effect_title(effect) for effect in report.effects if not effect.in_model_xml]
    blocks: list[Block] = [ModelDifference(text, SIDES)] if text else []
    if report.effects:
        blocks.append(Text(f"Added: {join_items([describe_values(effect) for effect in report.effects])}."))
    if missing:
        is_plain = report.gap.delivered == "plain"
        blocks.append(Text(DELIVERED["plain"] if is_plain else NOT_WRITTEN.format(join_items(missing))))
    if report.retuned:
        blocks.append(tables.make_retuned_table(report))
    if undetermined := describe_conditioning(report):
        blocks.append(Text(undetermined))
    return blocks or [Text("Nothing: the model is unchanged.")]


def describe_values(effect: NamedEffect) -> str:
    """Return an effect with its joint and parameters."""
    values = [f"{as_words(name)} {format_with_si(one.value, one.unit)}" for name, one in effect.parameters.items()]
    return f"{format_effect_title(effect)} ({', '.join(values)})"


def make_error_blocks(report: GapReport, series: Series) -> list[Block]:
    """Return the errors of all models, overall and per joint."""
    drawn = [charts.draw_model_errors(report, series), *charts.draw_joint_errors(report, series)]
    return [*drawn, *describe_shares(report), tables.make_gap_table(series, select_models(report, series))]


def describe_shares(report: GapReport) -> list[Text]:
    """Describe the explained shares of the gap; empty without a gap."""
    shares = report.shares
    if report.verdict == "none" or not shares or shares.names is None:
        return []
    named = "named effects and retuning explain" if report.effects else "retuning explains"
    learned = "" if shares.learned is None else f", the learned correction φ {shares.learned:.1%}"
    left = "" if shares.left is None else f"; {shares.left:.1%} is left"
    left_out = [Text(f"{describe_learned(report.phi)}.")] if report.phi and not report.phi.helps else []
    return [Text(f"Of the squared error above the noise, {named} {shares.names:.1%}{learned}{left}."), *left_out]


def make_effects_blocks(report: GapReport) -> list[Block]:
    """Return the table of named effects, with remarks on each."""
    if not report.effects:
        return [Text("No effect was named.")]
    more = [(format_effect_title(effect), list_remarks(effect)) for effect in report.effects]
    return [
        tables.make_effects_table(report),
        *[Text(f"{capitalise(name)}. {' '.join(text)}") for name, text in more if text],
    ]


def make_motion_blocks(report: GapReport, series: Series, folder: Path) -> list[Block]:
    """Return measured and predicted motion of every joint, as film and charts."""
    film = make_film_blocks(folder, report, series)
    return [*film, charts.draw_errors_over_time(report, series), *charts.draw_joint_charts(report, series)]


def make_unexplained_blocks(report: GapReport) -> list[Block]:
    """Return the remaining errors."""
    found = report.find
    open_questions = [Text(sentence) for sentence in (found.undecidable if found else ())]
    if report.unexplained:
        return [*[Text(describe_rest(entry)) for entry in report.unexplained], *open_questions]
    return [
        Text("Nothing: no joint's error on the held-out episodes stays clearly above the noise."),
        *open_questions,
    ]


def make_placebo_blocks(report: GapReport, series: Series) -> list[Block]:
    """Return the error of the runner-up in place of a name."""
    placebo, gap = report.placebo, report.gap
    if not placebo:
        return []
    # the error in the chart; the search's own number is of slightly different predictions
    left = placebo.after if series.placebo is None else float(np.sqrt((series.by_episode(series.placebo) ** 2).mean()))
    text = as_words(placebo.text).rstrip(".") or join_items([format_effect_title(effect) for effect in placebo.effects])
    return [
        Text(
            f"{capitalise(text)}: with the same freedom to fit, this placebo leaves "
            f"{format_value(left, gap.unit)} of the {format_error(gap, 'before')} before. "
            f"The named effects leave {format_error(gap, 'after')}. If the placebo does as well, do not trust the name."
        ),
        *charts.draw_placebo_errors(series),
    ]


def make_next_experiment_blocks(report: GapReport) -> list[Block]:
    """Return the proposed experiment."""
    text = report.next_experiment
    if not text:
        return [Text("Nothing: no rival explanation is close enough to need an experiment.")]
    return [Text(f"{capitalise(text.rstrip('.'))}."), *tables.make_experiments_table(report)]


PAGE, FIGURES = "report.html", "figures"


def show(folder: Path) -> Path:
    """Write figures and page of a folder with `report.json`, `series.npz`, and usually `model.xml` and `model.diff`.

    Returns:
        Path of the page.

    Raises:
        OptionError: one of the first two files is missing or incomplete.
    """
    report, series = GapReport.read(folder / REPORT), Series.read(folder)
    figures = {"gap_per_joint.png": draw_all_joints(report, series)}
    names = make_file_names(series.joints)
    for joint in find_joints_above(series):
        figures[f"joint_{names[series.joints[joint]]}.png"] = draw_joint(report, series, joint)
    for stale in (folder / FIGURES).glob("*.png"):
        if stale.name not in figures:
            stale.unlink()
    for name, figure in figures.items():
        write_atomic(folder / FIGURES / name, to_png(figure))
    path = folder / PAGE
    write_atomic(path, build_page(report, series, folder).to_html().encode())
    return path
