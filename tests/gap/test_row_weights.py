"""Rows that a hypothesis cannot predict have little weight; all others keep theirs."""

from dataclasses import replace

import numpy as np
import pytest
from support.evidence_samples import QUANTUM, measured

from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.fit import fit
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, select_free_base
from nas_data.gap.search.row_weights import compute_row_weights, weigh_rows

FLOOR = np.full(6, QUANTUM / np.sqrt(12))
CHAOTIC = slice(20, 26)


@pytest.fixture(scope="module")
def tasks() -> tuple[FitTask, FitTask]:
    nominal, evidence = measured()
    whole = FitTask(nominal, evidence, FLOOR)
    return whole.select([0, 1]), whole.select([2])


def test_smooth_motion_has_its_full_weight_and_its_fit_as_start(tasks: tuple[FitTask, FitTask]):
    fitted, held = tasks
    parameters = FreeParameters((), select_free_base(fitted.nominal.base, ()))
    found = fit(fitted, parameters, parameters.initial_theta(), steps=2)
    assert found is not None
    *weighed, start = weigh_rows(fitted, held, found)
    assert not any(task.has_unpredictable_rows for task in weighed)
    assert np.array_equal(start, found.theta)
    assert weighed[0].misfit(found.predicted) == fitted.misfit(found.predicted)


@pytest.mark.parametrize("size", [0.1, 3.0, 100.0])
def test_rows_that_small_changes_move_beyond_the_errors_count_as_the_typical_ones(
    tasks: tuple[FitTask, FitTask], size: float
):
    fitted, _ = tasks
    centre = fitted.evidence.measured
    others = [centre.copy() for _ in range(8)]
    for sign, other in zip((1, -1) * 4, others, strict=True):
        other[0, CHAOTIC, 1] += sign * size * FLOOR[1]
    weights = compute_row_weights(fitted, [centre, *others])
    expected = np.ones_like(centre)
    expected[0, CHAOTIC, 1] = min(1.0, 1.0 / size)
    assert np.allclose(weights, expected, rtol=1e-9)


def test_scores_no_longer_depend_on_the_branch_of_a_chaotic_motion(tasks: tuple[FitTask, FitTask]):
    fitted, _ = tasks
    centre = fitted.evidence.measured + 0.5 * FLOOR
    branch = centre.copy()
    branch[0, CHAOTIC, 1] += 100 * FLOOR[1]
    apart = fitted.misfit(branch) - fitted.misfit(centre)
    weighed = replace(fitted, row_weights=compute_row_weights(fitted, [centre, branch]))
    assert apart > 2 * PRICE, "the branch decides, or this test shows nothing"
    assert 0 <= weighed.misfit(branch) - weighed.misfit(centre) < 0.1 * apart
    assert np.array_equal(weighed.select([1]).row_weights, weighed.row_weights[[1]])
