"""The search as a whole: what is hidden in small arms is recovered, from both ends."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.search_samples import afresh, arm, begun, names, played, tasks
from support.start_samples import derived_torques

from nas_data.effects.base import parse
from nas_data.gap.name import name
from nas_data.gap.problem import Problem
from nas_data.gap.search.choose import choose, search_down, search_up
from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.plain_fit import (
    choose_start,
    convert_to_effects,
    describe_plain_fit,
    fit_plain,
    fit_smooth,
    refine_smooth,
)
from nas_data.gap.search.search import Search
from nas_data.gap.search.share_gain import fit_with_gain, share_gain

VISCOUS, DRY = "viscous_friction:joint=j2,coefficient=0.03", "coulomb_friction:joint=j1,torque=0.03"
FRICTION = (("coulomb_friction", "torque=0.01"), ("viscous_friction", "coefficient=0.004"))


# The plain fit


def test_a_plain_fit_recovers_gain_damping_friction_and_inertia():
    """The gain of the model is ten times too high, as where it was made up to hold still."""
    true = {"gain": 0.5, "damping": 0.03, "armature": 0.001, "frictionloss": 0.01}
    model = {"gain": 5.0, "damping": 0.015, "armature": 0.0015, "frictionloss": 0.02}
    search = begun(arm(**model), target=arm(**true), episodes=4)
    found = fit_plain(search)
    for joint in ("j1", "j2"):
        for kind, value in true.items():
            factor = found.fit.factors[f"{joint}.{kind}"]
            assert model[kind] * factor == pytest.approx(value, rel=0.05), f"{joint}.{kind}"
    assert search.floor_ratios(found).max() < 1.2


def test_one_gain_for_all_servos_is_fitted_from_torques_in_proportion():
    """Where friction rules, gain and friction of a joint stand for each other; here both are half the model's."""
    true, model = {"gain": 0.5, "frictionloss": 0.02}, {"gain": 1.0, "frictionloss": 0.04}
    search = begun(arm(**model), target=arm(**true), episodes=4)
    plain = fit_plain(search)
    joints = ["j1", "j2"]
    far = fit_with_gain(search, plain, joints, 0.8)
    assert far is not None
    gains = [effect.factor for effect in far.effects if effect.name() == "servo_stiffness"]
    assert gains == [pytest.approx(0.5, rel=0.1)] * 2
    assert gains[0] == gains[1]
    assert [0.04 * far.fit.factors[f"{joint}.frictionloss"] for joint in joints] == [pytest.approx(0.02, rel=0.1)] * 2


def test_a_plain_fit_that_explains_all_keeps_a_gain_for_each_joint():
    search = begun(arm(gain=1.0), target=arm(gain=0.5), episodes=4)
    plain = fit_plain(search)
    assert share_gain(search, plain) is plain


def test_a_plain_fit_adds_what_the_model_lacks_to_an_arm_that_begins_in_motion():
    """Torque-driven joints of which the model has no friction at all."""
    effects = [f"{kind}:joint={joint},{value}" for joint in ("j1", "j2") for kind, value in FRICTION]
    model = arm(motors=True, damping=0.0, armature=0.001)
    nominal, evidence = played(model, size=0.05, seconds=0.9)
    speeds = np.random.default_rng(1).uniform(-2, 2, evidence.initial_positions.shape)
    started = replace(
        evidence,
        initial_velocities=speeds,
        estimated_velocities=speeds,
        velocity_deviations=np.full(speeds.shape, 1e-3),
    )
    truth = nominal.predict(started, [parse(text) for text in effects])
    search = Search.begin(*tasks(nominal, replace(started, measured=truth)))
    found = {(effect.name(), effect.joint): effect for effect in fit_plain(search).effects}
    for joint in ("j1", "j2"):
        assert found["coulomb_friction", joint].torque == pytest.approx(0.01, rel=0.05)
        assert found["viscous_friction", joint].coefficient == pytest.approx(0.004, rel=0.05)


def test_a_plain_fit_begins_near_a_model_that_is_nearly_right():
    """Friction of a tenth of a strong servo's torque would be far from this arm's."""
    search = begun(arm(gain=50.0, damping=1.5, armature=0.05), "coulomb_friction:joint=j2,torque=0.3", episodes=4)
    parameters = describe_plain_fit(search, ["j1", "j2"]).parameters(search.train.nominal.base)
    start, usual = choose_start(search, parameters), parameters.initial_theta(search.null.fit.factors)
    near, far = (search.task.misfit(search.task.predict(parameters, theta)) for theta in (start, usual))
    null = search.null.fit.misfit
    assert near - null < 0.2 * (far - null)
    assert not search.null.fit.loss < fit_smooth(search).fit.loss


def test_a_plain_fit_recovers_how_much_of_the_weight_a_controller_carries():
    model = arm().replace("<body ", '<body gravcomp="1" ')
    search = begun(model, target=model.replace('gravcomp="1"', 'gravcomp="0.6"'))
    factors = fit_plain(search).fit.factors
    assert [factors[f"{joint}.gravcomp"] for joint in ("j1", "j2")] == pytest.approx([0.6, 0.6], abs=0.05)


@pytest.mark.slow
def test_gravity_compensation_that_the_model_lacks_is_named():
    found = begun(arm(), "gravity_compensation:share=0.7")
    (effect,) = choose(found).best.effects
    assert effect.name() == "gravity_compensation"
    assert effect.share == pytest.approx(0.7, abs=0.05)


@pytest.mark.slow
def test_a_torque_limit_that_the_plain_fit_lowers_is_named():
    """A freed limit that nothing stood for explained what was missing, unnamed."""
    limited = arm().replace('kp="0.5"', 'kp="0.5" forcerange="-0.3 0.3"')
    found = begun(limited, "joint_offset:joint=j1,offset=0.08", "torque_limit:joint=j1,torque=0.12")
    first, smooth = found.current_round, refine_smooth(found, fit_smooth(found))
    assert "torque_limit" in {effect.name() for effect in convert_to_effects(found, smooth).effects}
    found.return_to(first)
    kept = {effect.name(): effect for effect in choose(found).best.effects}
    assert set(kept) == {"joint_offset", "torque_limit"}
    assert kept["torque_limit"].torque == pytest.approx(0.12, rel=0.03)


# Both ends


@pytest.fixture(scope="module")
def rubbing() -> Search:
    return begun(arm(), VISCOUS, DRY)


@pytest.mark.slow
def test_up_from_the_model_and_down_from_the_plain_fit_meet(rubbing: Search):
    search = afresh(rubbing)
    first = search.current_round
    plain = fit_plain(search)
    named = convert_to_effects(search, plain)
    assert "viscous_friction" in {effect.name() for effect in named.effects}
    search.return_to(first)
    assert search.task.objective == rubbing.task.objective and search.null is rubbing.null
    up, down = search_up(afresh(rubbing), rubbing.null), search_down(afresh(rubbing), plain)
    for h in (up, down):
        assert names(h.effects) == names([parse(VISCOUS), parse(DRY)])
        sizes = {effect.name(): getattr(effect, effect.parameters[0].name) for effect in h.effects}
        # All torques of an arm may change by the same few percent without changing its motion.
        assert sizes == pytest.approx({"viscous_friction": 0.03, "coulomb_friction": 0.03}, rel=0.1)
    assert abs(rubbing.rescore(up).score.over(rubbing.rescore(down).score)) < PRICE


@pytest.mark.slow
def test_what_one_effect_explains_is_named_though_the_plain_fit_leaves_more():
    search = begun(arm(), "backlash:joint=j1,half_width=0.03")
    choice = choose(search)
    assert names(choice.best.effects) == [("backlash", "j1")]
    assert search.count_unexplained(choice.best) == 0 < search.count_unexplained(choice.plain)


def test_a_search_among_joints_that_stood_still_names_nothing(rubbing: Search):
    search = afresh(rubbing)
    search.excited = set()
    assert choose(search).best is search.null


@pytest.mark.slow
def test_servos_that_all_lack_the_same_are_named_together():
    """All gains are a tenth of the model's."""
    naming = name(*tasks(*played(arm(gain=5.0), target=arm(gain=0.5))))
    assert names(naming.final.effects) == [("servo_stiffness", "j1"), ("servo_stiffness", "j2")]
    assert [effect.factor for effect in naming.final.effects] == pytest.approx([0.1] * 2, rel=0.05)


@pytest.mark.slow
def test_a_recording_cut_out_of_a_motion_tells_both_frictions_of_a_spindle(tmp_path: Path):
    """A log at 500 Hz in pieces of 2 s that begin at up to 6 rad/s, velocities derived, inertia 7.5 % off."""
    dataset = derived_torques(*spindle())
    model = tmp_path / "model.xml"
    model.write_text(SPINDLE)
    problem = Problem.of(dataset, model, tmp_path)
    assert np.abs(problem.evidence.initial_velocities).max() > 4
    effects = name(problem.train, problem.held).final.effects
    assert names(effects) == [("coulomb_friction", "spindle"), ("viscous_friction", "spindle")]
    sizes = {effect.name(): getattr(effect, effect.parameters[0].name) for effect in effects}
    assert sizes == pytest.approx({"viscous_friction": 0.04, "coulomb_friction": 0.10}, rel=0.05)


SPINDLE = """<mujoco><option timestep="0.0005" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
<joint name="spindle" axis="0 0 1"/><geom type="cylinder" size="0.05 0.02" contype="0" conaffinity="0" mass="1e-3"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/></body></worldbody>
<actuator><motor name="spindle" joint="spindle" ctrlrange="-2 2"/></actuator></mujoco>"""


def spindle(inertia: float = 0.0215, viscous: float = 0.04, dry: float = 0.10) -> tuple[np.ndarray, np.ndarray, float]:
    """Return positions [rad] and torques [N·m], shape (8, 1000), and rate [Hz], of a spindle that follows waves.

    Integrated at 0.1 ms; friction turns over within 2 mrad/s; positions come in steps of 1 µrad.
    """
    step, rate, pieces, each = 1e-4, 500.0, 8, 1000
    times, hold = np.arange(0, pieces * each / rate, step), round(1 / rate / step)
    waves = zip((0.8, 0.5, 0.25), (0.23, 0.61, 1.3), np.random.default_rng(4).uniform(0, 6, 3), strict=True)
    goals = sum(size * np.sin(2 * np.pi * f * times + phase) for size, f, phase in waves)
    q, v, torque, rows = float(goals[0]), 0.0, 0.0, []
    for number, goal in enumerate(goals.tolist()):
        if number % hold == 0:
            torque = min(max(4.0 * (goal - q) - 0.15 * v, -1.0), 1.0)
            rows.append((round(q, 6), torque))
        v += step * (torque - viscous * v - dry * np.tanh(v / 0.002)) / inertia
        q += step * v
    positions, torques = np.array(rows).T.reshape(2, pieces, each)
    return positions, torques, rate
