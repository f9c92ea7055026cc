"""Blind cases: a pure function of their name, sound datasets, no trace of the answer in what is handed over."""

import json

import numpy as np
import pytest
from support.blind_samples import shorten, shortened

from nas_data.benchmarks.blind.case import EVERY, FAMILIES, Identity
from nas_data.benchmarks.blind.catalogue import EVERYWHERE, INSIDE, OUTSIDE
from nas_data.benchmarks.blind.draw import UNLIKE, EffectSampler, EffectSizes, draw_case
from nas_data.benchmarks.blind.plants.hiding import RULES
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.settings.xl320 import FLOOR, QUANTUM
from nas_data.benchmarks.blind.write import ANSWER, DATASET, FRESH, NOMINAL, write_case
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.effects.base import find_effect, make_effect
from nas_data.errors import UnknownName


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    shorten(monkeypatch)


def test_the_same_name_gives_the_same_case():
    identity = {"family": "one", "plant": "mujoco", "number": 0, "seed": 0}
    one, other = shortened(**identity), draw_case(**identity)
    assert one.answer() == other.answer()
    np.testing.assert_array_equal(one.recorded.readings, other.recorded.readings)
    np.testing.assert_array_equal(one.fresh.readings, other.fresh.readings)


def test_another_number_seed_or_plant_gives_another_case():
    names = [("numpy", 0, 0), ("numpy", 1, 0), ("numpy", 0, 1), ("bullet", 0, 0)]
    draws = [Identity("one", *name).stream("effects").random() for name in names]
    assert len(set(draws)) == len(names)


@pytest.mark.parametrize(
    "family",
    [pytest.param(name, marks=() if name == "one" else pytest.mark.slow) for name in FAMILIES],
)
def test_each_family_hides_as_many_visible_effects_as_it_says(family):
    sizes = FAMILIES[family]
    plant = "numpy" if sizes.outside else "mujoco"
    case = shortened(family=family, plant=plant, number=0, seed=0)
    count = len(case.arm.joints) if family == EVERY else sizes.inside + sizes.outside
    assert len(case.truth.hidden) == count == len(case.marks)
    assert all(mark >= 3 for mark in case.marks)
    outside = [hidden for hidden in case.truth.hidden if hidden.effect in OUTSIDE]
    assert len(outside) == sizes.outside and all(hidden.effect in RULES for hidden in case.truth.hidden)
    assert (np.abs(np.array([*vars(case.truth.base).values()]) - 1) <= 0.1).all()


@pytest.mark.parametrize("setting", ["xl320", "any", "torque"])
def test_every_joint_lacks_the_same_effect_in_about_the_same_size(setting, monkeypatch):
    marks = EffectSizes((10.0,) * 7, (), np.empty(0), np.empty((0, 0)))  # whatever is drawn can be seen
    monkeypatch.setattr("nas_data.benchmarks.blind.draw.measure_marks", lambda *_: marks)
    identity = Identity(EVERY, "numpy", 1, 2, setting=setting)
    sort = find_setting(setting)
    hider = EffectSampler(identity, sort, *sort.draw(identity))
    effects = set()
    for _ in range(30):
        group = hider.hide(lambda *_: None)[0].hidden
        assert [hidden.joint for hidden in group] == list(hider.constants.joints)
        assert len({hidden.effect for hidden in group}) == 1
        effects.add(effect := group[0].effect)
        alike = [sort.inside[effect].draw(np.random.default_rng(0), hider.constants, row, False)
                 for row in range(len(group))]  # fmt: skip
        for key in set(alike[0]) & set(group[0].parameters):
            sizes = [hidden.parameters[key] / values[key] for hidden, values in zip(group, alike, strict=True)]
            assert max(sizes) <= UNLIKE * min(sizes) * (1 + 1e-9)
        for hidden in group:
            assert not make_effect(hidden.effect, hidden.joint, hidden.parameters).is_neutral
    assert effects == set(EVERYWHERE) & set(sort.inside)


@pytest.mark.slow
def test_faint_cases_may_hide_less(monkeypatch):
    (mark,) = draw_case("one", "numpy", 0, 0, faint=True).marks
    assert mark >= 0.3


def test_a_written_case_is_a_sound_dataset(tmp_path):
    case = shortened(family="one", plant="mujoco", number=0, seed=0)
    write_case(case, tmp_path / "case")
    folder = tmp_path / "case" / DATASET
    assert verify(folder) == []
    dataset = read(folder)
    n = len(case.arm.joints)
    positions = dataset.states[:, :n].astype(float)
    np.testing.assert_allclose(positions / QUANTUM, np.round(positions / QUANTUM), atol=1e-4)
    noise = case.recorded.readings - case.recorded.positions
    assert 0.8 * FLOOR < np.sqrt(np.square(noise).mean()) < 1.6 * FLOOR
    row = dataset.episode(1).start + 4
    backward = (dataset.states[row, :n] - dataset.states[row - 1, :n]) * 100
    np.testing.assert_allclose(dataset.states[row, n:], backward, atol=1e-4)


def test_what_is_handed_over_holds_no_trace_of_the_answer(tmp_path):
    case = shortened(family="three", plant="mujoco", number=0, seed=0)
    write_case(case, tmp_path)
    told = b"".join(path.read_bytes() for path in (tmp_path / DATASET).rglob("*") if path.is_file())
    told += (tmp_path / NOMINAL).read_bytes()
    secret = [hidden.effect for hidden in case.truth.hidden] + [case.identity.name, "answer"]
    assert not [word for word in secret if word.encode() in told]
    assert json.loads((tmp_path / ANSWER).read_text())["effects"]
    with np.load(tmp_path / FRESH) as fresh:
        assert fresh["readings"].shape[1] == fresh["commands"].shape[1] + 1


def test_every_effect_that_can_hide_has_a_rule_and_stands_in_the_contract():
    inside = {**INSIDE, **find_setting("torque").inside}
    assert set(RULES) == {*inside, *OUTSIDE}
    for name, kind in inside.items():
        assert {"whole_arm": find_effect(name).whole_arm, "per_joint": find_effect(name).per_joint} == {
            "whole_arm": kind.whole_arm,
            "per_joint": kind.per_joint,
        }


def test_there_is_no_such_family():
    with pytest.raises(UnknownName, match="family"):
        draw_case("four", "numpy", 0, 0)
