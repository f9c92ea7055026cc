"""Initial states are eliminated from a fit: each hypothesis has its own most likely ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.search_samples import arm, played

from nas_data.effects.base import parse
from nas_data.gap.search.fit import Fit, build_normal_equations, fit, measure_jacobian
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.search.initial_states import StartResponse
from nas_data.gap.search.objective import FitTask

SHAPE = 3, 8, 2  # episodes, steps, joints


def response(seed: int, certain: bool = False) -> tuple[StartResponse, np.ndarray]:
    """Return a random response of four coordinates, the last of which is certain in the first episode; and errors."""
    rng = np.random.default_rng(seed)
    deviations = rng.uniform(0.1, 2.0, (3, 4)) * (not certain)
    deviations[0, -1] = 0.0
    changes = rng.normal(size=(3, 4)) * deviations
    made = StartResponse(rng.normal(size=(4, *SHAPE)), rng.uniform(0.1, 3.0, (3, 1, 2)), changes, deviations)
    return made, rng.normal(size=SHAPE)


def loss(made: StartResponse, errors: np.ndarray, steps: np.ndarray) -> float:
    """Return ½ Σ w² (e + S δ)² + ½ Σ (x / σ)² for steps δ."""
    moved = errors + np.einsum("cetn,ec->etn", made.jacobian, steps)
    free = made.deviations > 0
    return 0.5 * float(
        ((made.weights * moved) ** 2).sum() + (((made.changes + steps)[free] / made.deviations[free]) ** 2).sum()
    )


@given(seed=st.integers(0, 10_000), size=st.floats(1e-3, 1.0))
@settings(max_examples=40, deadline=None)
def test_the_most_likely_initial_states_minimise_errors_and_prior(seed: int, size: float):
    made, errors = response(seed)
    _, scaled = made.absorb(errors)
    best = scaled * made.deviations - made.changes
    other = best + size * made.deviations * np.random.default_rng(seed + 1).normal(size=best.shape)
    assert loss(made, errors, best) <= loss(made, errors, other)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_a_change_of_the_errors_is_absorbed_in_proportion(seed: int):
    made, errors = response(seed)
    change = np.random.default_rng(seed + 1).normal(size=(5, *SHAPE))
    before, after = made.absorb(errors), made.absorb(errors + change)
    for one, other, difference in zip(before, after, made.absorb_change(change), strict=True):
        assert np.allclose(one + difference, other)
    part = made.select([2]).absorb(errors[[2]])
    assert np.allclose(part[0], before[0][[2]]) and np.allclose(part[1], before[1][[2]])


def test_certain_initial_states_absorb_nothing():
    made, errors = response(0, certain=True)
    left, scaled = made.absorb(errors)
    assert np.array_equal(left, errors) and not scaled.any()


@pytest.fixture(scope="module")
def begun() -> tuple[FitTask, Fit]:
    """A torque-driven arm that rubs, in episodes whose initial velocities are known to 0.05 rad/s, and its model."""
    nominal, evidence = played(arm(motors=True), ["viscous_friction:joint=j2,coefficient=0.002"], size=0.01)
    rng = np.random.default_rng(0)
    velocities = rng.normal(0.0, 0.3, evidence.initial_positions.shape)
    truth = nominal.predict(replace(evidence, initial_velocities=velocities), (parse(HIDDEN),))
    estimated = velocities + rng.normal(0.0, 0.05, velocities.shape)
    measured = replace(
        evidence,
        measured=truth + rng.normal(0.0, 1e-4, truth.shape),
        initial_velocities=estimated,
        estimated_velocities=estimated,
        velocity_deviations=np.full(velocities.shape, 0.05),
        noise=np.full(2, 1e-4),
    )
    task = FitTask(nominal, measured, np.full(2, 1e-4))
    parameters = Description((parse(GUESS),)).parameters(nominal.base)
    task = task.relinearise(parameters, parameters.initial_theta())
    predicted = task.predict(parameters, parameters.initial_theta())
    assert predicted is not None
    theta = parameters.initial_theta()
    jacobian = measure_jacobian(task, parameters, theta, predicted, range(parameters.size))
    return task, Fit(parameters, theta, predicted, task.misfit(predicted), jacobian, task.objective)


HIDDEN = "viscous_friction:joint=j2,coefficient=0.004"
GUESS = "viscous_friction:joint=j2,coefficient=0.002"


def test_the_gradient_of_the_misfit_counts_that_initial_states_follow(begun):
    task, found = begun
    _, gradient = build_normal_equations(task, found.predicted, found.jacobian)
    small = 1e-4
    for column, rows in enumerate(found.jacobian):
        ahead, behind = (task.misfit(found.predicted + sign * small * rows) for sign in (1, -1))
        assert gradient[column] == pytest.approx((ahead - behind) / (2 * small), rel=0.05, abs=0.05)


def test_a_fit_needs_few_rounds_though_the_initial_states_are_unknown(begun):
    """With initial states that stay where they are in each round, it needs many."""
    task, found = begun

    def fitted(absorbing: bool) -> float:
        now, theta = task, found.theta
        for _ in range(2):
            now = now.relinearise(found.parameters, theta)
            now = now if absorbing else replace(now, start_response=None)
            better = fit(now, found.parameters, theta)
            assert better is not None
            theta = better.theta
        return float(found.parameters.effects_at(theta)[0].coefficient)

    absorbing, fixed = (abs(fitted(way) / 0.004 - 1) for way in (True, False))
    assert absorbing < 0.03
    assert fixed > 3 * absorbing
