"""Models whose gains are far from the true ones: nothing else is wrong with them, and the answer says all of it."""

import numpy as np
import pytest
from support.blind_samples import INDEPENDENT, answered, entry_of, know_everything, know_nothing, report_of, shorten

from nas_data.benchmarks.blind.benchmark import BlindPlan, run
from nas_data.benchmarks.blind.case import FAMILIES, Base, Identity, Truth
from nas_data.benchmarks.blind.designs import draw_design
from nas_data.benchmarks.blind.draw import EffectSampler, draw_case
from nas_data.benchmarks.blind.grade import grade_names
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.settings.far import EXCESS, draw_gain_excess

FAR = find_setting("far")


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    shorten(monkeypatch)


def named(number: int, family: str = "none") -> Identity:
    return Identity(family, "numpy", number, 5, setting="far")


def test_only_the_gains_are_far_off_and_by_one_factor():
    factors = []
    for number in range(20):
        arm, conditions = FAR.draw(named(number))
        true = draw_design(named(number).stream("arm"), conditions.period)
        model, own = Constants.of(arm.model()), Constants.of(true.model())
        factors.append(draw_gain_excess(named(number)))
        np.testing.assert_allclose(model.gain, factors[-1] * own.gain, rtol=1e-4)
        for same in ("damping", "servo_damping", "armature", "friction", "force", "masses"):
            np.testing.assert_array_equal(getattr(model, same), getattr(own, same))
    assert EXCESS[0] <= min(factors) < 6 and 25 < max(factors) <= EXCESS[1]


@pytest.mark.slow
@pytest.mark.parametrize("plant", INDEPENDENT)
def test_with_its_answer_a_plant_moves_as_the_arm_with_the_true_servos(plant):
    arm, conditions = FAR.draw(named(7))
    true, base = draw_design(named(7).stream("arm"), conditions.period), Base.nominal(len(arm.joints))
    control = Constants.of(arm.model()).control
    commands, poses = FAR.episodes(conditions, 2, control, np.random.default_rng(0))
    episodes = commands, poses, conditions.period, conditions.settle
    one = find_plant(plant)(arm, [Truth(base, FAR.given(named(7), arm))], *episodes)
    other = find_plant(plant)(true, [Truth(base)], *episodes)
    assert np.abs(one - other)[..., : len(arm.joints)].max() < conditions.sensor.noise


@pytest.mark.slow
@pytest.mark.parametrize("family", ["none", "one"])
def test_families_hide_their_effects_beside_the_gains(family):
    case = draw_case(family, "numpy", 0, 3, setting="far")
    hidden, joints = case.truth.hidden, case.arm.joints
    assert len(hidden) == len(joints) + FAMILIES[family].inside
    assert [effect.joint for effect in hidden if effect.effect == "servo_stiffness"] == list(joints)
    assert all(FAR.least <= mark <= FAR.most for mark in case.marks[len(joints) :])
    assert min(case.marks) > FAR.least  # the far gains can be seen, too


def test_sizes_are_drawn_for_the_servos_that_the_arm_has():
    identity = named(0, "one")
    arm, conditions = FAR.draw(identity)
    true = draw_design(identity.stream("arm"), conditions.period)
    drawn = EffectSampler(identity, FAR, arm, conditions).constants
    np.testing.assert_allclose(drawn.gain, Constants.of(true.model()).gain, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_who_knows_everything_is_right_about_far_gains_too(plant, tmp_path):
    plan = BlindPlan(("none",), (plant,), 1, 4, setting="far")
    found = run(plan, tmp_path, know_everything, lambda line: None)[0].outcome
    assert found.grade.exact and found.grade.verdict_right and len(found.grade.true) > 1, found
    assert found.fresh.after < found.fresh.floor + 0.3 * found.fresh.before, found
    assert not run(plan, tmp_path / "nothing", know_nothing, lambda line: None)[0]["exact"]


def test_outside_the_catalogue_the_gains_are_still_to_be_named():
    gain = {
        "effect": "servo_stiffness",
        "joint": "j1",
        "parameters": {"factor": 0.1},
        "mark": 9.0,
        "marked_joint": "j1",
    }
    cogs = {"effect": "cogging", "joint": "j1", "parameters": {"torque": 0.1}, "mark": 9.0, "marked_joint": "j1"}
    answer = answered([gain, cogs], family="outside", joints=["j1"])
    rest = [{"joint": "j1", "ratio_to_noise": 4.0, "goes_with": "position"}]
    found = grade_names(answer, report_of([entry_of("servo_stiffness", "j1", {"factor": 0.1})], "unexplained", rest))
    assert found.exact and found.verdict_right and found.unexplained_joint_named
    assert not grade_names(answer, report_of([], "unexplained", rest)).exact
