"""The page of a gap report: verdict first, then what was found, pictures, what to record next, and how to read it."""

from collections.abc import Sequence

from nas_data.gap.report import GapReport
from nas_data.gap.showing.page_pictures import joint_pictures, models, regimes_picture, shrinking
from nas_data.gap.showing.page_tables import (
    audit_facts,
    effects_table,
    experiments_table,
    facts,
    gap_table,
    joints_table,
    regimes_table,
    retuned_table,
)
from nas_data.gap.showing.page_verdict import error, lead, model, rest, score_basis
from nas_data.gap.showing.page_words import capital, effect_title, finding, friendly, join_items, spoken
from nas_data.gap.showing.series import Series
from nas_data.reports.page import Block, HtmlPage, PageSection, Text

READING = (
    "Gap: every held-out episode is simulated from its first pose with the recorded commands alone (open loop), and "
    "compared with the positions that were measured. No number was fitted to these "
    "episodes; they did decide which effects were kept.",
    "Noise floor: the readings themselves are rounded and noisy; no model can come closer than that. Every picture "
    "shows it.",
    "Confidence: how likely name and joint are right. Of names given with 90 %, nine in ten should be. A gap that "
    "shrinks does not prove a name: a wrong one shrinks it, too, only less, which the placebo shows.",
    "Interval: where the parameter lies with 95 %, if the name is right.",
    "Retuned: masses, gains, damping, rotor inertia and friction of a real arm are some percent off its model. They "
    "were free within ±25 % throughout, so that no effect is named for what they explain.",
    "model.xml is the model with all of this in it. It loads in plain MuJoCo; a sensor <joint>.pos says what is "
    "measured at each joint.",
)


def build(report: GapReport, series: Series) -> HtmlPage:
    """Return the page."""
    sections = [
        PageSection("", opening(report)),
        PageSection("What is missing", effects_blocks(report)),
        PageSection("What stays unexplained", rest_blocks(report)),
        PageSection("What was retuned", retuned_blocks(report)),
        PageSection("How the gap shrinks", [*shrinking(report, series), gap_table(series, models(report, series))]),
        PageSection("Joint by joint", joint_pictures(report, series)),
        PageSection("A wrong name in its place", placebo_blocks(report)),
        PageSection("What to record next", next_blocks(report)),
        PageSection("Where the gap is", where_blocks(report)),
        PageSection("The recording itself", audit_facts(report)),
        PageSection("How to read this", [Text(line) for line in (*READING, score_basis(report))]),
        PageSection("What this rests on", [facts(report)]),
    ]
    return HtmlPage(f"Gap report of {model(report)}", [section for section in sections if section.blocks])


def opening(report: GapReport) -> list[Block]:
    """Return the verdict, every name with its numbers, and what stays."""
    found = [Text(" ".join(finding(effect)[:3])) for effect in report.effects]
    return [Text(lead(report), lead=True), *found, *[Text(rest(entry)) for entry in report.unexplained]]


def effects_blocks(report: GapReport) -> list[Block]:
    """Return the table of named effects, and what gives each away."""
    if not report.effects:
        return []
    more = [(effect_title(effect), finding(effect)[3:]) for effect in report.effects]
    return [effects_table(report), *[Text(f"{capital(name)}. {' '.join(rest)}") for name, rest in more if rest]]


def rest_blocks(report: GapReport) -> list[Block]:
    """Return what is left, in a sentence where that is nothing."""
    found = report.find
    open_questions = [Text(sentence) for sentence in (found.undecidable if found else ())]
    if report.unexplained:
        return [*[Text(rest(entry)) for entry in report.unexplained], *open_questions]
    return [
        Text("Nothing that stands out: no joint's error on the held-out episodes stays clearly above the noise."),
        *open_questions,
    ]


def retuned_blocks(report: GapReport) -> list[Block]:
    """Return the numbers of the model that were changed."""
    if not report.retuned:
        return [Text("Nothing: every number that the model already has was kept.")]
    return [retuned_table(report)]


def placebo_blocks(report: GapReport) -> list[Block]:
    """Return how much less the runner-up shrinks the gap."""
    placebo, gap = report.placebo, report.gap
    if not placebo:
        return []
    told = spoken(placebo.text).rstrip(".") or join_items([effect_title(effect) for effect in placebo.effects])
    return [
        Text(
            f"{capital(told)}: with the same freedom to fit, this placebo leaves "
            f"{friendly(placebo.after, gap.unit)} of the {error(gap, 'before')} before. "
            f"What is named leaves {error(gap, 'after')}."
        )
    ]


def next_blocks(report: GapReport) -> list[Block]:
    """Return the experiment that would say more."""
    text = report.next_experiment
    if not text:
        return [Text("Nothing in particular: no rival explanation is close enough to be worth an experiment.")]
    return [Text(f"{capital(text.rstrip('.'))}."), *experiments_table(report)]


def where_blocks(report: GapReport) -> Sequence[Block]:
    """Return the gap of the model as handed over, by joint and by condition."""
    return [*joints_table(report), *regimes_picture(report), *regimes_table(report)]
