"""Other arms than the Ergo Jr: as different as users' are, well designed, and the same on every plant."""

from functools import cache

import mujoco
import numpy as np
import pytest
from support.blind_samples import INDEPENDENT, drawn, reference, shorten

from nas_data.benchmarks.blind.case import Base, Hidden, Truth
from nas_data.benchmarks.blind.motions import SIGNALS
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import PlantBody, hide
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.effects.base import make_effect

OTHER = find_setting("any")
ARMS = [4, 7, 11]  # numbers of drawn arms: three, six and seven joints


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    shorten(monkeypatch)


def test_other_arms_differ_in_all_that_users_differ_in():
    many = [drawn(number, episodes=1)[:2] for number in range(60)]
    assert {len(arm.joints) for arm, _ in many} == {2, 3, 4, 5, 6, 7}
    for words in ("<position", "<general", 'integrator="Euler"', 'integrator="implicitfast"', "ctrlrange"):
        assert 0 < sum(words in arm.xml for arm, _ in many) < 60
    assert {conditions.signal for _, conditions in many} == set(SIGNALS)
    assert {conditions.rate for _, conditions in many} == {50, 100, 200}
    assert len({conditions.sensor.quantum for _, conditions in many}) == 3
    assert {conditions.sensor.speed_noise is None for _, conditions in many} == {True, False}
    for arm, conditions in many:
        steps = conditions.period / arm.model().opt.timestep
        assert steps == pytest.approx(round(steps)) and round(steps) >= 5


@pytest.mark.parametrize("number", range(12))
def test_a_drawn_servo_is_as_quick_and_as_strong_as_it_should_be(number):
    """Whatever the servo was drawn for, the model says: mass matrix and weight in random postures."""
    constants, model = Constants.of(drawn(number)[0].model()), drawn(number)[0].model()
    rng, data, mass = np.random.default_rng(0), mujoco.MjData(model), np.zeros((model.nv, model.nv))
    inertias, weights = [], []
    for _ in range(100):
        data.qpos[:] = rng.uniform(-1.2, 1.2, model.nq)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        inertias.append(np.diag(mass).copy())
        weights.append(np.abs(data.qfrc_bias))
    inertia = np.mean(inertias, axis=0)
    frequency = np.sqrt(constants.gain / inertia)
    ratio = (constants.damping + constants.servo_damping) / (2 * frequency * inertia)
    assert ((frequency > 2 * np.pi * 2.3) & (frequency < 2 * np.pi * 6.5)).all()
    assert ((ratio > 0.45) & (ratio < 1.2)).all()
    assert (constants.force[:, 1] > 1.5 * np.max(weights, axis=0)).all()
    assert (np.abs(constants.centres[:, :2]).max(axis=1) > 0).all()


@pytest.mark.parametrize("number", range(12))
def test_whatever_hides_in_other_arms_is_an_effect_of_the_contract(number):
    constants, rng = Constants.of(drawn(number)[0].model()), np.random.default_rng(number)
    for name, kind in OTHER.inside.items():
        for row, joint in enumerate(constants.joints):
            made = make_effect(name, joint if kind.per_joint else None, kind.draw(rng, constants, row, False))
            assert not made.is_neutral


@cache
def moved(number: int) -> np.ndarray:
    """Return positions (1, T + 1, n) of a nominal drawn arm in MuJoCo."""
    arm, conditions, commands, poses = drawn(number)
    return reference(arm, commands, poses, conditions.period, conditions.settle)


@pytest.mark.slow
@pytest.mark.parametrize("plant", INDEPENDENT)
@pytest.mark.parametrize("number", ARMS)
def test_without_effects_a_plant_follows_mujoco_within_the_noise(plant, number):
    arm, conditions, commands, poses = drawn(number)
    n = len(arm.joints)
    played = find_plant(plant)(arm, [Truth(Base.nominal(n))], commands, poses, conditions.period, conditions.settle)[0]
    true = moved(number)
    assert np.abs(played[:, 0, :n] - true[:, 0]).max() < conditions.sensor.noise
    assert np.sqrt(np.square(played[..., :n] - true).mean(axis=(0, 1))).max() < conditions.sensor.noise
    speeds = np.gradient(true, conditions.period, axis=1)[:, 1:-1]
    error = np.sqrt(np.square(played[:, 1:-1, n:] - speeds).mean())
    assert error < 0.1 * np.sqrt(np.square(speeds).mean())


LOAD = {"mass": 0.3, "x": 0.1, "y": -0.05, "z": 0.08}


@cache
def followed(plant: str, number: int) -> np.ndarray:
    """Return states (3, 1, T + 1, 2n) of a drawn arm as it is, with a load beside its link, or at its centre."""
    arm, conditions, commands, poses = drawn(number)
    hidden = ((), (Hidden("payload", None, LOAD),), (Hidden("payload", None, {"mass": LOAD["mass"]}),))
    truths = [Truth(Base.nominal(len(arm.joints)), one) for one in hidden]
    return find_plant(plant)(arm, truths, commands, poses, conditions.period, conditions.settle)


@pytest.mark.parametrize("number", [ARMS[0], *(pytest.param(number, marks=pytest.mark.slow) for number in ARMS[1:])])
def test_the_model_handed_over_follows_its_plant_up_to_its_timestep(number):
    """MuJoCo's positions run ahead by half a timestep, for a step adds the speed at its end."""
    arm, conditions, *_ = drawn(number)
    n, (one, other) = len(arm.joints), (followed(plant, number)[0] for plant in ("numpy", "mujoco"))
    ahead = arm.model().opt.timestep * np.sqrt(np.square(one[..., n:]).mean(axis=(0, 1)))
    apart = np.sqrt(np.square(one - other)[..., :n].mean(axis=(0, 1)))
    assert (apart < conditions.sensor.noise + ahead).all()


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow])])
def test_a_payload_weighs_where_it_is(plant):
    """A load beside the link turns the joints otherwise than one at its centre of mass; all plants alike."""
    n, (own, native) = len(drawn(ARMS[0])[0].joints), (followed(name, ARMS[0]) for name in (plant, "mujoco"))
    moved = [np.sqrt(np.square(shown[1] - shown[2])[..., :n].mean()) for shown in (own, native)]
    assert moved[0] == pytest.approx(moved[1], rel=0.1) and moved[0] > np.radians(0.1)


def test_two_bodies_that_turn_as_one_have_the_inertia_of_both():
    constants = Constants.of(drawn(4)[0].model())
    body = hide(constants, Truth(Base.nominal(3), (Hidden("payload", None, {"mass": 0.4, "x": 0.1, "z": -0.2}),)))
    plain = PlantBody.of(constants, Base.nominal(3))
    load = plain.centres[-1] + np.array([0.1, 0, -0.2])
    for point in (np.zeros(3), load, np.array([0.3, 0.1, -0.2])):  # about any point, moments of inertia add up
        parts = about(point, plain.centres[-1], plain.masses[-1], plain.inertias[-1]) + about(point, load, 0.4, 0)
        np.testing.assert_allclose(about(point, body.centres[-1], body.masses[-1], body.inertias[-1]), parts)


def about(point, centre, mass, inertia):
    """Return a body's inertia about a point."""
    arm = centre - point
    return inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
