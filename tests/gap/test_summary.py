"""The text summary of a gap report."""

from dataclasses import replace

import pytest
from support.report_samples import gap_report

from nas_data.effects.base import make_effect
from nas_data.gap.compose import name_with_place
from nas_data.gap.report import GapReport
from nas_data.gap.showing.page_words import describe_verdict
from nas_data.gap.summary import list_findings

EVIDENCE = {"heldout_error_before": 0.1, "heldout_error_after": 0.01}


def named(joint: str | None, rival: str, rival_joint: str | None) -> GapReport:
    return gap_report(
        effects=[
            {
                "effect": "command_delay",
                "joint": joint,
                "parameters": {"delay": {"value": 0.04, "unit": "s", "interval95": [0.03, 0.05]}},
                "confidence": 0.7,
                "evidence": EVIDENCE,
                "alternatives": [{"effect": rival, "joint": rival_joint, "heldout_error_after": 0.05}],
                "equals": [],
            }
        ]
    )


@pytest.mark.parametrize(
    ("joint", "rival", "rival_joint", "said"),
    [
        (None, "command_delay", "waist", "runner-up command_delay waist: 2.86°"),
        ("waist", "command_delay", None, "runner-up command_delay of the whole arm: 2.86°"),
        ("waist", "backlash", "waist", "runner-up backlash: 2.86°"),
    ],
)
def test_a_runner_up_at_another_place_is_told_with_its_place(joint, rival, rival_joint, said):
    assert said in "\n".join(list_findings(named(joint, rival, rival_joint)))


def test_an_offset_that_varies_with_the_position_is_doubted_in_words():
    for dependence, is_doubted in ((0.9, True), (0.2, False), (None, False)):
        report = named("waist", "backlash", "waist")
        (effect,) = report.effects
        evidence = replace(effect.evidence, position_dependence=dependence)
        said = "\n".join(list_findings(replace(report, effects=(replace(effect, evidence=evidence),))))
        assert ("so it may not be constant" in said) is is_doubted


def test_a_gap_that_an_experiment_would_decide_is_not_said_to_lie_outside_the_catalogue():
    tried = {"name": "chirp", "on": ["waist"], "seconds": 12.0, "separation": 4.0, "joint": "waist"}
    rest = [{"joint": "waist", "ratio_to_noise": 3.0, "goes_with": "speed"}]
    for experiments, unexplained, said in (
        ([], rest, "no effect in the catalogue"),
        ([tried], rest, "does not decide"),
        ([], [], "does not decide"),
    ):
        report = gap_report(verdict="unexplained", experiments=experiments, unexplained=unexplained)
        assert said in list_findings(report)[0]
        assert said in describe_verdict(report)


def test_a_fit_that_the_data_do_not_determine_says_so():
    for number, is_told in ((3e8, True), (40.0, False), (None, False)):
        said = "\n".join(list_findings(gap_report(conditioning=number)))
        assert ("do not determine all parameters (condition number 3e+08)" in said) is is_told


def test_a_placebo_is_told_with_its_place():
    said = [name_with_place(make_effect("command_delay", joint, {"delay": 0.04})) for joint in (None, "waist")]
    assert said == ["command_delay in the whole arm", "command_delay in waist"]


@pytest.mark.parametrize(
    ("after", "verdict", "in_motion", "said"),
    [
        (0.1, "none", True, True),
        (0.1, "none", False, False),
        (0.02, "none", True, False),
        (0.1, "unexplained", True, False),
    ],
)
def test_an_explained_error_far_above_the_noise_is_told_to_come_from_the_initial_states(
    after, verdict, in_motion, said
):
    gap = {"unit": "rad", "before": after, "after": after, "noise_floor": 0.01}
    episodes = {"train": [0], "heldout": [1], "begin_in_motion": in_motion}
    report = gap_report(verdict=verdict, gap=gap, episodes=episodes)
    assert any("begin in motion" in line for line in list_findings(report)) == said
    assert ("initial states" in describe_verdict(report)) == said
