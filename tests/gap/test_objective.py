"""What a search minimises: scores of one objective, a tolerance that shrinks with the error, starts within doubt."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.evidence_samples import QUANTUM, measured
from support.search_samples import arm, played, tasks

from nas_data.effects.base import parse
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.nominal import with_timestep
from nas_data.gap.score_model import predict_episodes
from nas_data.gap.search.fit import evaluate_loss, fit
from nas_data.gap.search.initial_states import MAX_START_CHANGE
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters, select_free_base
from nas_data.gap.search.score import ObjectiveMismatch, Score
from nas_data.gap.search.timestep import choose_timestep

HEAVY = "rotor_inertia:joint=j1,inertia=0.01"
FLOOR = np.full(6, QUANTUM / np.sqrt(12))
NATS = st.floats(-1e6, 1e6)


@given(one=NATS, other=NATS, same=st.booleans(), cost=st.floats(0, 100))
def test_only_scores_of_one_objective_are_compared(one: float, other: float, same: bool, cost: float):
    first, second = Score(one, 1), Score(other, 1 if same else 2)
    if same:
        assert (first < second) == (one < other) == (second > first)
        assert (first <= second) == (one <= other) == (second >= first)
        assert first.over(second) == one - other == -second.over(first)
        assert min(first, second).nats == min(one, other)
        assert first + cost >= first
        return
    for compare in (Score.__lt__, Score.__le__, Score.__gt__, Score.__ge__, Score.over):
        with pytest.raises(ObjectiveMismatch):
            compare(first, second)


def test_episodes_and_starts_make_another_objective_and_a_misfit_that_is_added_the_same():
    train, held = tasks(*played(arm(), ["viscous_friction:joint=j2,coefficient=0.03"]))
    parameters = FreeParameters((), train.nominal.base)
    theta = parameters.initial_theta()
    others = [train.select([0]), train.reestimate(parameters, theta), train.relinearise(parameters, theta), held]
    scores = [evaluate_loss(task, parameters, theta) for task in (train, *others)]
    assert len({score.objective for score in scores}) == len(scores)
    for score in scores[1:]:
        with pytest.raises(ObjectiveMismatch):
            min(scores[0], score)
    joined = held.with_tolerance_of(others[2])
    assert evaluate_loss(joined, parameters, theta).objective == others[2].objective
    assert np.array_equal(joined.tolerance[0], others[2].tolerance[0])


def test_small_errors_do_not_matter_while_large_ones_are_left():
    nominal, evidence = measured("viscous_friction:joint=m2,coefficient=0.2")
    parameters = FreeParameters((), nominal.base)
    task = FitTask(nominal, evidence, FLOOR)
    coarse = task.relinearise(parameters, parameters.initial_theta())
    left = np.sqrt(evidence.mean_squares(nominal.predict(evidence)).mean(0))
    assert np.sqrt(coarse.tolerance)[0, 1] == pytest.approx(np.hypot(FLOOR[1], 0.1 * left[1]), rel=0.05)
    assert left[1] > 20 * FLOOR[1], "there is a large error, or this test shows nothing"
    assert task.tolerance == pytest.approx(np.broadcast_to(FLOOR**2, task.floors.shape))
    assert np.array_equal(coarse.select([0]).tolerated_error, coarse.tolerated_error)


@pytest.mark.parametrize("fine", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_physics_steps_of_a_recording_are_told_after_both_were_fitted(fine: bool):
    """Parameters of the model that were fitted to the wrong steps speak for them."""
    nominal, evidence = measured(factors={"m2.gain": 1.05, "m3.damping": 0.95}, timestep=2.5e-4 if fine else None)
    parameters = FreeParameters((), select_free_base(nominal.base, ()))
    wrong = FitTask(nominal, evidence.select([0, 1]), FLOOR, fine=not fine).relinearise(
        parameters, parameters.initial_theta()
    )
    found = fit(wrong, parameters, parameters.initial_theta(), steps=5)
    assert found is not None
    task, better = choose_timestep(wrong.relinearise(parameters, found.theta), found)
    assert task.fine == fine
    assert task.timestep == (5e-4 if fine else 2e-3)
    assert choose_timestep(task, better)[0].fine == fine


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize(("coefficient", "longer"), [(0.2, True), (0.0, False)])
def test_rollouts_take_longer_steps_while_errors_are_large(fine: bool, coefficient: float, longer: bool):
    """Whichever physics steps the recording is taken to have; the correction makes up for the longer ones."""
    nominal, evidence = measured(f"viscous_friction:joint=m2,coefficient={coefficient}" if coefficient else "")
    evidence = replace(evidence, measured=evidence.measured + (0.05 if longer else 0.0))
    parameters = FreeParameters((), nominal.base)
    theta = parameters.initial_theta()
    task = FitTask(nominal, evidence, FLOOR, fine=fine).correct_timestep((), {})
    assert (task.coarse_model is not None) == longer
    predicted = task.predict(parameters, theta)
    assert predicted is not None
    own = with_timestep(nominal, task.timestep).predict(evidence)
    assert np.allclose(predicted, own, atol=1e-9)


@pytest.mark.parametrize("off", [0.0, 1.0, -2.0, 30.0])
def test_starts_move_within_their_doubt_towards_what_explains_the_motion(off: float):
    """Velocities are told wrong by so many of their standard deviations."""
    nominal, evidence = played(arm())
    true, doubts = np.full(evidence.initial_positions.shape, 0.4), np.full(evidence.initial_positions.shape, 0.1)
    truth = nominal.predict(replace(evidence, initial_velocities=true))
    told = true + off * doubts
    task = FitTask(
        nominal,
        replace(
            evidence, measured=truth, initial_velocities=told, estimated_velocities=told, velocity_deviations=doubts
        ),
        np.full(2, 1e-4),
    )
    begun = task.estimate_initial_states((), {}).evidence
    assert np.all(np.abs(begun.initial_velocities - told) <= MAX_START_CHANGE * doubts + 1e-12)
    apart = np.abs(begun.initial_velocities - true).max()
    assert apart < 0.5 * np.abs(told - true).max() + 1e-3 or abs(off) > MAX_START_CHANGE
    assert task.misfit(nominal.predict(begun)) <= task.misfit(nominal.predict(task.evidence)) + 1e-9
    assert np.array_equal(begun.estimated_velocities, told)
    again = replace(task, evidence=begun).estimate_initial_states((), {}).evidence
    assert np.allclose(again.initial_velocities, begun.initial_velocities), "what was told does not wander"


def test_what_begins_at_rest_stays_at_rest():
    nominal, evidence = played(arm(), ["viscous_friction:joint=j2,coefficient=0.03"])
    effects = (parse("backlash:joint=j1,half_width=0.02"),)
    begun = FitTask(nominal, evidence, np.full(2, 1e-4)).estimate_initial_states(effects, {}).evidence
    assert np.array_equal(begun.initial_velocities, np.zeros_like(begun.initial_velocities))


def test_a_rest_does_not_contain_what_an_estimated_initial_state_adds():
    """Initial velocities are estimated wrong by two standard deviations; the model is right."""
    nominal, evidence = played(arm(motors=True))
    estimated = np.full(evidence.initial_positions.shape, 0.1)
    truth = nominal.predict(replace(evidence, initial_velocities=estimated + 0.02))
    began = replace(
        evidence,
        measured=truth,
        initial_velocities=estimated,
        estimated_velocities=estimated,
        velocity_deviations=np.full(estimated.shape, 0.01),
    )
    task = FitTask(nominal, began, np.full(2, 1e-4))
    predicted = nominal.predict(began)
    assert compute_floor_ratios(began.mean_squares(predicted), task.floor).min() > 3
    right, wrong = (predict_episodes(task, nominal, effects) for effects in ((), (parse(HEAVY),)))
    assert np.array_equal(right.positions, predicted)
    assert compute_floor_ratios(right.squares, task.floor).max() < 1
    assert compute_floor_ratios(wrong.squares, task.floor).max() > 3
