"""Hypotheses: what they cost, which of their numbers they share, which columns of a Jacobian they may reuse."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.search_samples import arm, described, played, tasks
from support.typical_effects import NAMES, typical

from nas_data import registry
from nas_data.effects.base import parse
from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.final import compute_conditioning, fit_final
from nas_data.gap.search.fit import (
    NEGLECTED_SHARE,
    Fit,
    fit,
    group_columns,
    is_effect_or_freed,
    measure_jacobian,
    measure_moved_joints,
)
from nas_data.gap.search.hypothesis import (
    Description,
    Hypothesis,
    compute_effect_price,
    excited_joints,
    find_joints_beyond_prior,
    reuse_jacobian,
)
from nas_data.gap.search.intervals import compute_error_ratios
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters

VISCOUS = [f"viscous_friction:joint=j{number},coefficient=0.02" for number in (1, 2, 3)]
DRY = [f"coulomb_friction:joint=j{number},torque=0.02" for number in (1, 2, 3)]


@pytest.mark.parametrize("name", NAMES)
def test_a_fit_begins_at_its_guesses(name: str):
    """Also those of optional parameters, with a prior or without."""
    effect = typical(name)
    parameters = FreeParameters((effect,), ())
    (begun,) = parameters.effects_at(parameters.initial_theta())
    for parameter in effect.parameters:
        assert getattr(begun, parameter.name) == pytest.approx(getattr(effect, parameter.name))


@pytest.fixture(scope="module")
def task() -> FitTask:
    return tasks(*played(arm(joints=3), DRY[:1], episodes=3, seconds=0.9))[0]


def at_start(task: FitTask, description: Description) -> Fit:
    """Return a description at its guesses with a Jacobian that was measured there."""
    parameters = description.parameters(task.nominal.base)
    theta = parameters.initial_theta()
    predicted = task.predict(parameters, theta)
    assert predicted is not None
    jacobian = measure_jacobian(task, parameters, theta, predicted, range(parameters.size))
    return Fit(parameters, theta, predicted, task.misfit(predicted), jacobian, task.objective)


def test_a_column_is_reused_by_what_its_number_stands_for(task: FitTask):
    near = at_start(task, described(*VISCOUS, DRY[0]))
    wanted = described("backlash:joint=j2,half_width=0.02", DRY[0], VISCOUS[2]).parameters(task.nominal.base)
    known = reuse_jacobian(near, wanted)
    assert wanted.labels[0] == ("backlash", "j2", "half_width") and 0 not in known
    common = {index for index, label in enumerate(wanted.labels) if label in near.parameters.labels}
    assert set(known) == common >= {1, 2}
    for index, column in known.items():
        assert np.array_equal(column, near.jacobian[near.parameters.labels.index(wanted.labels[index])])
    assert 2 not in reuse_jacobian(near, wanted, fresh=1) and 1 in reuse_jacobian(near, wanted, fresh=1)
    assert reuse_jacobian(None, wanted) == {}


def test_a_reused_column_is_the_one_that_would_be_measured(task: FitTask):
    """Of a shared value it is the sum of the columns of the joints that share it."""
    single, shared = described(*VISCOUS), described(*VISCOUS, shared=["viscous_friction"])
    known = reuse_jacobian(at_start(task, single), shared.parameters(task.nominal.base))
    measured_there = at_start(task, shared)
    assert set(known) == set(range(measured_there.parameters.size))
    for index, column in known.items():
        own = measured_there.jacobian[index]
        assert np.abs(column - own).max() < 0.02 * np.abs(own).max()
    assert np.array_equal(known[0], at_start(task, single).jacobian[:3].sum(axis=0))


def with_reach(task: FitTask) -> FitTask:
    """Return a task that knows which joints the model's parameters move."""
    near = at_start(task, Description())
    return replace(task, moved_by_base=measure_moved_joints(task, near.parameters, near.predicted, near.jacobian))


def test_numbers_that_move_different_joints_are_measured_in_one_rollout(task: FitTask):
    knowing = with_reach(task)
    parameters = Description().parameters(task.nominal.base)
    groups = group_columns(knowing, parameters, range(parameters.size))
    assert sorted(column for group in groups for column in group) == list(range(parameters.size))
    assert len(groups) < parameters.size
    for group in groups:
        moved = sum(knowing.moved_by_base[parameters.labels[column][0]].astype(int) for column in group)
        assert len(group) == 1 or moved.max() == 1
    assert group_columns(task, parameters, [2, 0]) == [[2], [0]]


def test_a_column_measured_with_others_is_nearly_the_one_measured_alone(task: FitTask):
    alone, together = at_start(task, Description()), at_start(with_reach(task), Description())
    off = np.linalg.norm(together.jacobian - alone.jacobian, axis=(1, 2)).max(1)
    whole = np.linalg.norm(alone.jacobian.reshape(len(alone.jacobian), -1), axis=1)
    assert 0 < (off / whole).max() < 2 * NEGLECTED_SHARE


def test_what_may_be_anything_is_measured_alone(task: FitTask):
    description = described(VISCOUS[0], freed=["j1.gain"])
    parameters = description.parameters(task.nominal.base)
    loose = [column for column in range(parameters.size) if is_effect_or_freed(parameters, column)]
    assert [parameters.labels[column][0] for column in loose] == ["viscous_friction", "j1.gain"]
    groups = group_columns(with_reach(task), parameters, range(parameters.size))
    assert all([column] in groups for column in loose)


def test_joints_that_share_a_value_have_one_number(task: FitTask):
    shared = described(*VISCOUS, DRY[1], shared=["viscous_friction"]).parameters(task.nominal.base)
    assert shared.labels[:2] == [("viscous_friction", "*", "coefficient"), ("coulomb_friction", "j2", "torque")]
    theta = shared.initial_theta() + np.linspace(0.1, 0.5, shared.size)
    coefficients = [effect.coefficient for effect in shared.effects_at(theta)[:3]]
    assert coefficients == [pytest.approx(0.02 * np.exp(theta[0]))] * 3


@given(data=st.data())
def test_a_shared_value_costs_once_and_each_effect_of_its_own_once(data: st.DataObject):
    joints = data.draw(st.lists(st.integers(1, 9), min_size=1, unique=True))
    effects = [f"deadband:joint=j{number},half_width=0.02" for number in joints]
    freed = data.draw(st.sets(st.sampled_from(["j1.gain", "j2.gain", "j1.armature"])))
    own, alike = described(*effects, freed=freed), described(*effects, freed=freed, shared=["deadband"])
    one = compute_effect_price(parse(effects[0]))
    assert own.price == pytest.approx(PRICE * len(freed) + len(joints) * one)
    assert alike.price == pytest.approx(PRICE * len(freed) + one)
    assert own.without_effect(0).price == pytest.approx(own.price - one)
    assert alike.without_effect(0).shared == (frozenset({"deadband"}) if len(joints) > 1 else frozenset())


def test_more_parameters_cost_more_and_so_does_what_no_model_file_expresses():
    friction = parse("coulomb_friction:joint=m2,torque=0.02")
    stribeck = parse("stribeck_friction:joint=m2,torque=0.02,kinetic_ratio=0.5,stribeck_velocity=0.3")
    load = parse("load_friction:joint=m2,ratio=0.2")
    assert compute_effect_price(friction) < compute_effect_price(load) and compute_effect_price(
        friction
    ) < compute_effect_price(stribeck)
    assert not load.in_model
    costs = [compute_effect_price(parse(text)) for text in DRY]
    assert costs == [PRICE] * 3


def test_what_an_effect_replaces_is_not_fitted_beside_it(task: FitTask):
    freed = described(freed=["j1.gain", "j2.gain"])
    added = freed.add_effects(parse("servo_stiffness:joint=j1,factor=0.5"))
    assert added.freed == {"j2.gain"}
    names = {parameter.name: parameter for parameter in added.parameters(task.nominal.base).base}
    assert "j1.gain" not in names
    assert names["j2.gain"].is_free and not names["j3.gain"].is_free


def test_every_move_has_a_name_and_a_sentence():
    for name in registry.list_names("gap.search.moves"):
        module = registry.import_plugin("gap.search.moves", name, "move")
        assert module.__doc__ and module.apply.__doc__


# What a model's own parameters say


def retuned(factors: dict[str, float]) -> Hypothesis:
    """Return the model alone fitted to what it does with other parameters."""
    task, _ = tasks(*played(arm(frictionloss=0.02), factors=factors))
    parameters = Description().parameters(task.nominal.base)
    found = fit(task, parameters, parameters.initial_theta(), steps=4)
    assert found is not None
    return Hypothesis(Description(), found, np.zeros((1, 2)), 0.0)


def test_a_parameter_of_the_model_that_goes_too_far_is_seen():
    near, far = retuned({"j2.gain": 1.06}), retuned({"j2.gain": 1.24})
    assert find_joints_beyond_prior(near) == set()
    assert find_joints_beyond_prior(far) == {"j2"}


def test_friction_may_be_less_than_the_models_own_and_hardly_more():
    """More of it has a name."""
    kinds = {base.kind: base for base in played(arm(frictionloss=0.02))[0].base}
    friction, damping = kinds["frictionloss"], kinds["damping"]
    assert friction.deviation(-0.1) == damping.deviation(-0.1) == damping.deviation(0.1) > 2 * friction.deviation(0.1)
    for factor in (0.85, 1.15):
        near = retuned({"j2.frictionloss": factor}).fit.factors["j2.frictionloss"] == pytest.approx(factor, abs=0.04)
        assert near == (factor < 1)


def test_a_joint_that_stood_still_tells_no_cause(task: FitTask):
    assert excited_joints(task) == {"j1", "j2", "j3"}
    still = task.evidence.measured.copy()
    still[..., 1] = 0.0
    commands = task.evidence.commands.copy()
    commands[..., 2] = 0.3
    other = replace(task, evidence=replace(task.evidence, measured=still, commands=commands))
    assert excited_joints(other) == {"j1"}


def test_a_joint_with_one_goal_in_each_episode_is_excited(task: FitTask):
    """Steps to targets: the command changes between episodes only."""
    goals = np.zeros(task.evidence.commands.shape) + np.arange(len(task.evidence))[:, None, None]
    goals[..., 1] = 0.3
    steps = replace(task, evidence=replace(task.evidence, commands=goals))
    assert excited_joints(steps) == {"j1", "j3"}


def test_what_the_data_do_not_determine_has_a_condition_number_that_a_report_can_hold(task: FitTask):
    known = at_start(task, described(*VISCOUS[:2]))
    assert compute_conditioning(task, known) < 1e6
    silent = replace(known, jacobian=np.zeros_like(known.jacobian), parameters=described(VISCOUS[0]).parameters(()))
    silent = replace(silent, theta=silent.theta[:1], jacobian=silent.jacobian[:1])
    assert 1e12 < compute_conditioning(task, silent) < np.inf


def test_an_interval_stays_where_its_parameter_can_be():
    """The uncertainty of the model's own damping is larger than the friction beside it."""
    nominal, evidence = played(arm(damping=0.5), ["viscous_friction:joint=j2,coefficient=0.002"])
    damped = FitTask(nominal, evidence, np.full(2, 1e-4))
    found = fit_final(damped, described("viscous_friction:joint=j2,coefficient=0.002"), {}, rounds=1)
    low, high = found.intervals[0]["coefficient"]
    assert low == 0.0 < high


def test_an_interval_is_wider_where_an_error_remains(task: FitTask):
    """An error of one joint, ten noise floors large, leaves the other's interval as it is."""
    known = at_start(task, described(*DRY[:2]))
    error = np.zeros(known.predicted.shape)
    error[..., 0] = 10 * task.floor[0]
    evidence = replace(task.evidence, measured=known.predicted + error)
    ratios = compute_error_ratios(replace(task, evidence=evidence), known)
    assert 5 < ratios[0] < 10, "the other joints tell a little of its friction"
    assert 1 <= ratios[1] < 2, "and it of theirs"
    np.testing.assert_array_equal(
        compute_error_ratios(replace(task, evidence=replace(evidence, measured=known.predicted)), known), 1
    )


def test_an_interval_of_what_the_data_do_not_determine_has_ends():
    """A change of θ beyond all bounds, as from a curvature of nearly zero."""
    (free,) = described("coulomb_friction:joint=j1,torque=0.02").parameters(()).effect_parameters
    assert free.move(0.02, 1e4) == pytest.approx(20)
    assert free.move(0.02, -1e4) == pytest.approx(0.02e-3)
    assert free.value(1e4) == pytest.approx(20)
