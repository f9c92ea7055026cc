"""Confidence in a name: rivals, random draws of the episodes, and what remains each lower it."""

from types import SimpleNamespace

import numpy as np
import pytest

from nas_data.gap.confidence import Support, compute_chosen_share, compute_unexplained_share
from nas_data.gap.floor import compute_floor_ratios

FLOOR = np.array([0.01, 0.01])


def make_search() -> SimpleNamespace:
    """Return a search of 2 joints."""
    task = SimpleNamespace(misfits=lambda predicted: 10.0 * np.log(1 + predicted))
    held = SimpleNamespace(observations=np.full((4, 1), 20.0), tolerance=FLOOR**2, floor=FLOOR)
    search = SimpleNamespace(task=task, held=held, rescore=lambda h: h)
    search.floor_ratios = lambda h: compute_floor_ratios(h.heldout, FLOOR)
    return search


def make_hypothesis(fitted: np.ndarray, held: np.ndarray, price: float) -> SimpleNamespace:
    """Return a hypothesis with mean squared errors in floors², shape (E, 2) each."""
    description, fit = SimpleNamespace(price=price), SimpleNamespace(predicted=fitted)
    return SimpleNamespace(description=description, fit=fit, heldout=held * FLOOR**2)


def repeat(*values: float) -> np.ndarray:
    """Return errors (4, 2) that are the same in all episodes."""
    return np.tile(np.array(values), (4, 1))


SEARCH = make_search()
WITHOUT = make_hypothesis(repeat(9, 1), repeat(9, 1), 0.0)


def test_each_doubt_lowers_the_confidence():
    sure = Support(closest_rival=0.0, chosen=1.0, unexplained=0.0)
    assert sure.confidence == 1.0
    assert Support(closest_rival=1.0, chosen=1.0, unexplained=0.0).confidence == 0.5
    assert Support(closest_rival=0.0, chosen=0.6, unexplained=0.0).confidence == 0.6
    assert Support(closest_rival=0.0, chosen=1.0, unexplained=0.4).confidence == 0.6


def test_a_name_that_helps_in_every_episode_is_always_chosen():
    kept = make_hypothesis(repeat(1, 1), repeat(1, 1), 12.0)
    assert compute_chosen_share(SEARCH, kept, WITHOUT) == 1.0
    assert compute_chosen_share(SEARCH, WITHOUT, kept) == 0.0


def test_a_name_that_helps_in_one_episode_and_harms_in_others_is_chosen_in_some_draws():
    one = repeat(12, 1)
    one[0] = [0.2, 1]
    kept = make_hypothesis(one, repeat(9, 1), 0.0)
    assert 0.05 < compute_chosen_share(SEARCH, kept, WITHOUT) < 0.95


@pytest.mark.parametrize(("left", "expected"), [(1.0, 0.0), (2.25, 0.0), (4.25, 0.5), (9.0, 0.92)])
def test_what_remains_above_the_noise_counts(left, expected):
    kept = make_hypothesis(repeat(1, 1), repeat(left, 50), 12.0)
    assert compute_unexplained_share(SEARCH, kept, WITHOUT, [0]) == pytest.approx(expected, abs=0.01)
    assert compute_unexplained_share(SEARCH, kept, WITHOUT, [0, 1]) == 1.0


def test_a_name_is_unsure_where_many_noise_floors_remain():
    kept, without = (make_hypothesis(repeat(1, 1), repeat(left**2, 1), 0.0) for left in (8.0, 1000.0))
    assert compute_unexplained_share(SEARCH, kept, without, [0]) == pytest.approx(0.5)
    assert compute_unexplained_share(SEARCH, kept, without, [1]) == 0.0
