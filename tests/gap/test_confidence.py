"""Confidence in a name: rivals, random draws of the episodes, and what remains each lower it."""

from types import SimpleNamespace

import numpy as np
import pytest

from nas_data.effects.command_delay import CommandDelay
from nas_data.effects.joint_offset import JointOffset
from nas_data.gap.compose import compute_completeness, describe_joints
from nas_data.gap.confidence import Support, compute_chosen_share, compute_position_dependence
from nas_data.gap.nominal_parameters import NominalParameter
from nas_data.gap.rivals import compute_closeness
from nas_data.gap.search.score import Score


def make_search() -> SimpleNamespace:
    """Return a search of 2 joints."""
    task = SimpleNamespace(misfits=lambda predicted: 10.0 * np.log(1 + predicted))
    held = SimpleNamespace(compute_misfits=lambda squares: 10.0 * np.log(1 + squares))

    def log_error_ratios(with_: SimpleNamespace, without: SimpleNamespace) -> np.ndarray:
        return 0.5 * np.log(with_.heldout / without.heldout)

    return SimpleNamespace(task=task, held=held, rescore=lambda h: h, log_error_ratios=log_error_ratios)


def make_hypothesis(fitted: np.ndarray, held: np.ndarray, price: float, mass: float = 1.0) -> SimpleNamespace:
    """Return a hypothesis with mean squared errors in floors², shape (E, 2) each, and the factor of a link's mass."""
    base = NominalParameter("m1", "mass", ("link",))
    prior = 0.5 * (np.log(mass) / base.tolerance) ** 2
    misfit = SEARCH.task.misfits(fitted).sum() + SEARCH.held.compute_misfits(held).sum()
    return SimpleNamespace(
        fit=SimpleNamespace(predicted=fitted, parameters=SimpleNamespace(base=(base,)), factors={base.name: mass}),
        heldout=held,
        score=Score(float(misfit + prior) + price, 0),
    )


def repeat(*values: float) -> np.ndarray:
    """Return errors (4, 2) that are the same in all episodes."""
    return np.tile(np.array(values), (4, 1))


SEARCH = make_search()
WITHOUT = make_hypothesis(repeat(9, 1), repeat(9, 1), 0.0)


def test_each_doubt_lowers_the_confidence():
    assert Support(closest_rival=0.0, chosen=1.0, rest=2.0, left=0.9).confidence == 1.0
    assert Support(closest_rival=1.0, chosen=1.0, rest=1.0, left=0.9).confidence == 0.5
    assert Support(closest_rival=0.0, chosen=0.6, rest=1.0, left=0.9).confidence == 0.6
    assert Support(closest_rival=0.0, chosen=1.0, rest=8.0, left=0.9).confidence == 0.5
    assert Support(closest_rival=0.0, chosen=1.0, rest=1.0, left=0.1, stable=False).confidence == 0.5
    assert Support(closest_rival=0.0, chosen=1.0, rest=1.0, left=0.1, stable=None).confidence == 1.0


def make_offset_search(wave: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Return a search of 1 joint, and a fit with noise of 1 mrad and an error of a wave [rad] over the position."""
    rng = np.random.default_rng(0)
    positions = np.cumsum(rng.normal(scale=0.05, size=(4, 400, 1)), axis=1)
    evidence = SimpleNamespace(
        joints=("m1",),
        measured=positions,
        mask=np.ones((4, 400), bool),
        errors=lambda predicted: predicted - positions,
    )
    predicted = positions + rng.normal(scale=1e-3, size=positions.shape) + wave * np.sin(2 * positions)
    return SimpleNamespace(task=SimpleNamespace(evidence=evidence)), SimpleNamespace(
        fit=SimpleNamespace(predicted=predicted)
    )


def test_an_error_that_depends_on_the_position_contradicts_an_offset_in_proportion_to_it():
    small, large = JointOffset(joint="m1", offset=0.01), JointOffset(joint="m1", offset=-0.2)
    for wave, offset, low, high in ((0.0, small, 0.0, 0.2), (0.005, small, 1.0, 1.0), (0.005, large, 0.0, 0.1)):
        contradicts = compute_position_dependence(*make_offset_search(wave), offset)
        assert contradicts is not None and low <= contradicts <= high
    assert compute_position_dependence(*make_offset_search(0.005), CommandDelay(delay=0.02)) is None
    doubted = Support(closest_rival=0.1, chosen=1.0, rest=1.0, left=0.1, position_dependence=1.0)
    assert doubted.confidence == 0.5


def test_what_remains_matters_less_the_more_a_name_explains():
    shares = (1.2, 0.9, 0.4, 0.1)
    sure = [Support(closest_rival=0.0, chosen=1.0, rest=32.0, left=left).confidence for left in shares]
    assert sure == [0.25, 0.25, 0.6, 0.9]


def test_a_name_that_helps_in_every_episode_is_always_chosen():
    kept = make_hypothesis(repeat(1, 1), repeat(1, 1), 12.0)
    assert compute_chosen_share(SEARCH, kept, WITHOUT) == 1.0
    assert compute_chosen_share(SEARCH, WITHOUT, kept) == 0.0


def test_a_name_that_helps_in_one_episode_and_harms_in_others_is_chosen_in_some_draws():
    one = repeat(12, 1)
    one[0] = [0.2, 1]
    kept = make_hypothesis(one, repeat(9, 1), 0.0)
    assert 0.05 < compute_chosen_share(SEARCH, kept, WITHOUT) < 0.95


def test_the_prior_counts_in_every_draw():
    kept, without = (make_hypothesis(repeat(1, 1), repeat(1, 1), 0.0, mass) for mass in (1.0, 0.8))
    assert compute_chosen_share(SEARCH, kept, without) == 1.0
    assert compute_chosen_share(SEARCH, without, kept) == 0.0


@pytest.mark.parametrize(("factor", "closeness"), [(0.9, 1.0), (0.81, 0.0), (1.3, 0.0)])
def test_a_rival_that_contradicts_the_prior_is_not_close(factor, closeness):
    kept, rival = (make_hypothesis(repeat(1, 1), repeat(1, 1), 0.0, mass) for mass in (1.0, factor))
    assert compute_closeness(SEARCH, kept, rival) == closeness
    assert compute_closeness(SEARCH, rival, rival) == 1.0, "both contradict it"


def test_a_joint_is_at_most_as_complete_as_its_names_are_certain():
    def find(joint: str | None, confidence: float) -> SimpleNamespace:
        return SimpleNamespace(effect=SimpleNamespace(local_joint=joint), confidence=confidence)

    held = SimpleNamespace(evidence=SimpleNamespace(joints=("m1", "m2", "m3")))
    for arm, expected in (([], [0.6, 0.868, 0.139]), ([find(None, 0.4)], [0.4, 0.4, 0.139])):
        naming = SimpleNamespace(findings=[find("m1", 0.9), find("m1", 0.6), *arm], stable={})
        joints = describe_joints(held, naming, np.array([1.0, 1.2, 3.0]))
        assert [joint.complete for joint in joints.values()] == expected


def test_a_joint_that_is_not_explained_is_not_called_complete():
    assert compute_completeness(1.5, 1.5, []) == 0.8
    assert compute_completeness(1.01 * 1.5, 1.5, []) < 0.8
    assert compute_completeness(1.0, 1.5, [0.97]) == 0.97


def test_a_joint_beside_one_that_is_not_explained_is_complete_only_at_its_floor():
    held = SimpleNamespace(evidence=SimpleNamespace(joints=("m1", "m2")))
    naming = SimpleNamespace(findings=[], stable={})
    for other, is_complete in ((1.4, True), (3.0, False)):
        joints = describe_joints(held, naming, np.array([1.35, other]))
        assert (joints["m1"].complete >= 0.8) == is_complete
