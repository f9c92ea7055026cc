"""Baselines of the blind benchmark: each answers a case in its form and predicts what it was not given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.blind_samples import arms, positions, shorten, steps

from nas_data import registry
from nas_data.benchmarks.blind.baselines import one_step, phi, sysid
from nas_data.benchmarks.blind.baselines.base import find_baseline
from nas_data.benchmarks.blind.case import Base, Episodes, Hidden, HiddenEntry, SealedAnswer, Truth
from nas_data.benchmarks.blind.draw import draw_case
from nas_data.benchmarks.blind.fresh import Fresh, compute_oracle_error
from nas_data.benchmarks.blind.settings.xl320 import SENSOR
from nas_data.benchmarks.blind.write import ANSWER, DATASET, NOMINAL, write_case
from nas_data.dataset.layout import read_json
from nas_data.typed_json import from_json


@pytest.fixture(scope="module")
def weak_servo(tmp_path_factory):
    """Return the folder of a case in which the servo of m3 has half its gain, and nothing else is off."""
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        return written_case(tmp_path_factory.mktemp("weak"))


def written_case(folder: Path) -> Path:
    """Write a case with a weak servo into a folder; return where."""
    arm = arms()[0]
    commands, poses = steps(3, 0.9)
    truth = Truth(Base.nominal(6), (Hidden("servo_stiffness", "m3", {"factor": 0.5}),))
    true = positions("mujoco", arm, [truth], commands, poses)[0]
    episodes = Episodes(commands, poses, true, SENSOR.positions(true, np.random.default_rng(0)))
    case = draw_case("none", "mujoco", 0, 0)
    write_case(replace(case, arm=arm, truth=truth, recorded=episodes, fresh=episodes, marks=(9.0,),
                       marked_joints=("m3",), felt_joints=(("m3",),)), folder / "case")  # fmt: skip
    return folder / "case"


def test_every_baseline_can_be_found_by_its_name():
    assert registry.list_names("benchmarks.blind.baselines") == ("one_step", "phi", "plain", "sysid")
    assert all(callable(find_baseline(name)) for name in registry.list_names("benchmarks.blind.baselines"))


def test_fitting_all_parameters_closes_the_gap_and_blames_one_of_them(weak_servo, monkeypatch):
    monkeypatch.setattr(sysid, "EPISODES", 1)
    monkeypatch.setattr(sysid, "ITERATIONS", 2)
    claim = sysid.answer(weak_servo / DATASET, weak_servo / NOMINAL)
    assert [finding.name[0] in sysid.PARAMETERS.values() for finding in claim.findings] == [True]
    fresh = Fresh.load(weak_servo, arms()[0].joints)
    before = fresh.errors_of_models(weak_servo, weak_servo / NOMINAL).before
    assert fresh.error(claim.predict) < 0.5 * before


def test_one_step_regression_answers_and_leaves_the_model_alone(weak_servo):
    claim = one_step.answer(weak_servo / DATASET, weak_servo / NOMINAL)
    fresh = Fresh.load(weak_servo, arms()[0].joints)
    assert len(claim.findings) <= 1
    assert fresh.error(claim.predict) == fresh.errors_of_models(weak_servo, weak_servo / NOMINAL).before


def test_the_learned_residual_names_nothing_and_predicts(weak_servo, monkeypatch):
    monkeypatch.setattr(phi, "SMALL", {"updates": 1, "frames": 50, "horizon": 10, "hidden": 8, "shortcut": False})
    claim = phi.answer(weak_servo / DATASET, weak_servo / NOMINAL)
    assert not claim.findings
    assert Fresh.load(weak_servo, arms()[0].joints).error(claim.predict) is not None


def test_who_knows_the_answer_leaves_least(weak_servo):
    fresh = Fresh.load(weak_servo, arms()[0].joints)
    answer = from_json(SealedAnswer, read_json(weak_servo / ANSWER))
    errors = fresh.errors_of_models(weak_servo, weak_servo / NOMINAL)
    least = compute_oracle_error(weak_servo, answer, fresh)
    assert fresh.floor < least < 0.5 * errors.before
    assert compute_oracle_error(weak_servo, replace(answer, effects=()), fresh) == pytest.approx(errors.before, rel=0.1)
    play = HiddenEntry("backlash", "m3", {"half_width": 0.01}, 5.0, "m3")
    rubs = HiddenEntry("load_friction", "m3", {"ratio": 0.3}, 5.0, "m3")
    assert compute_oracle_error(weak_servo, replace(answer, effects=(rubs,)), fresh) > least
    for beyond in ((HiddenEntry("cable", "m3", {}, 5.0, "m3"),), (play, rubs)):  # beside play no file can hold it
        assert compute_oracle_error(weak_servo, replace(answer, effects=beyond), fresh) is None
