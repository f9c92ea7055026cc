"""The gate: what `nas gap` must get right on drawn blind cases, three small ones always and thirty if asked for.

The master seed was chosen before any of these cases was run. Do not draw again where a bar is missed.
"""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from nas_data.benchmarks.blind.benchmark import describe_case, run_cases
from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.grade import ConfidenceGrade
from nas_data.benchmarks.blind.record import CaseFailure
from nas_data.benchmarks.blind.run_case import CaseRunner
from nas_data.benchmarks.blind.tables import compute_rest, compute_share, median
from nas_data.commands.benchmark_gap import investigate
from nas_data.gap import workflow

pytestmark = pytest.mark.timeout(1200)  # a busy machine shares its processors

SEED = 20261126
SURE = 0.9  # confidence from which a wrong name is inexcusable
KEPT_IN = "NAS_GATE_OUT"  # environment variable: folder in which cases of the slow gate are kept, and gone on with

SMALL = [  # setting, family, plant, number
    ("small", "none", "numpy", 0),
    ("small", "one", "mujoco", 0),
    ("small", "outside", "numpy", 0),
]
MORE = [
    ("small", "none", "mujoco", 0),
    ("small", "one", "mujoco", 1),
    ("small", "two", "mujoco", 0),
]
LARGE = [
    ("xl320", "none", "numpy", 0),
    ("any", "none", "bullet", 0),
    ("xl320", "none", "bullet", 0),
    ("any", "none", "numpy", 0),
    ("xl320", "one", "numpy", 0),
    ("any", "one", "bullet", 0),
    ("xl320", "one", "bullet", 0),
    ("any", "one", "numpy", 0),
    ("xl320", "one", "numpy", 1),
    ("any", "one", "bullet", 1),
    ("xl320", "two", "numpy", 0),
    ("any", "two", "bullet", 0),
    ("xl320", "two", "bullet", 0),
    ("any", "two", "numpy", 0),
    ("xl320", "two", "bullet", 1),
    ("xl320", "three", "numpy", 0),
    ("any", "three", "bullet", 0),
    ("xl320", "three", "bullet", 0),
    ("any", "three", "numpy", 0),
    ("any", "three", "numpy", 1),
    ("xl320", "outside", "numpy", 0),
    ("any", "outside", "bullet", 0),
    ("xl320", "outside", "bullet", 0),
    ("any", "outside", "numpy", 0),
]


def identities(table):
    """Return what names the cases of a table."""
    return [Identity(family, plant, number, SEED, setting=setting) for setting, family, plant, number in table]


def inside(records):
    """Return the cases in which the catalogue holds all that hides."""
    return [record for record in records if record.identity.family != "outside"]


def inexact(records):
    """Return which cases of the catalogue were not named exactly."""
    return [describe_case(record) for record in inside(records) if not record.outcome.grade.exact]


def surely_wrong(records):
    """Return the cases in which a wrong name has a high confidence."""
    return [describe_case(record) for record in records if any(map(is_surely_wrong, record.outcome.grade.confidences))]


def is_surely_wrong(entry):
    """Whether a name is wrong and told with confidence."""
    return entry.confidence >= SURE and not entry.right


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Judge the small cases."""
    return judge_small(SMALL, tmp_path_factory.mktemp("small"))


def judge_small(table, out):
    """Judge small cases; pictures and the next experiment decide no name, and are left out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workflow, "show", lambda *_: None)
        patch.setattr(workflow, "propose_experiment", lambda *_: workflow.Proposal())
        return run_cases(identities(table), CaseRunner(investigate), out, print)


def check_predictions(records):
    """Check that models predict as well as those of who knows the answer.

    Short episodes leave more than the floor even then: how they began is seen only through the sensors.
    """
    assert not [record.outcome.fault for record in records if isinstance(record.outcome, CaseFailure)]
    errors = [record.outcome.fresh for record in inside(records)]
    assert median(one.after / one.least for one in errors) <= 1.2


def test_small_cases_are_named_exactly(small):
    assert len(inside(small)) == 2
    assert not inexact(small)


def test_no_small_case_is_surely_wrong(small):
    assert not surely_wrong(small)


def test_small_cases_have_models_that_predict_as_well_as_who_knows_the_answer(small):
    check_predictions(small)


@pytest.mark.slow
def test_six_small_cases_keep_every_bar(small, tmp_path):
    six = [*small, *judge_small(MORE, tmp_path)]
    assert len(inside(six)) == 5
    assert len(inexact(six)) <= 1, inexact(six)
    assert not surely_wrong(six)
    check_predictions(six)


def test_a_bar_is_missed_by_who_is_sure_and_wrong(small):
    sure = {"exact": False, "confidences": (ConfidenceGrade(SURE, False),)}
    found = [replace(record.outcome, grade=replace(record.outcome.grade, **sure)) for record in small]
    wrong = [replace(record, outcome=outcome) for record, outcome in zip(small, found, strict=True)]
    assert len(inexact(wrong)) == 2
    assert len(surely_wrong(wrong)) == 3


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """Judge the large cases, for about half an hour."""
    out = Path(os.environ.get(KEPT_IN) or tmp_path_factory.mktemp("large"))
    return run_cases(identities(LARGE), CaseRunner(investigate), out, print)


def of_family(records, family):
    """Return the cases of a family."""
    return [record for record in records if record.identity.family == family]


@pytest.mark.slow
@pytest.mark.bullet
@pytest.mark.timeout(4 * 3600)
def test_twenty_four_drawn_cases_keep_every_bar(large):
    known = inside(large)
    assert (len(large), len(known)) == (24, 20)
    assert not [record.outcome.fault for record in large if isinstance(record.outcome, CaseFailure)]
    assert len(inexact(large)) <= 2, inexact(large)
    assert not surely_wrong(large)
    assert not [describe_case(record) for record in of_family(large, "none") if record.outcome.grade.named]
    assert not [
        describe_case(record) for record in of_family(large, "outside") if record.outcome.grade.verdict == "explained"
    ]
    errors = [record.outcome.fresh for record in known]
    assert median(compute_rest(one.after, one.floor) for one in errors) <= 1.2
    assert compute_share(entry.covered for record in known for entry in record.outcome.grade.parameters) >= 0.85
