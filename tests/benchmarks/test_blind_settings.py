"""Settings of the blind benchmark: the default as it ever was; other arms, rates and sensors as they say."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from support.blind_samples import answered, drawn, entry_of, know_everything, report_of, shorten

from nas_data import registry
from nas_data.benchmarks.blind.benchmark import BlindPlan, run
from nas_data.benchmarks.blind.case import Case, Identity
from nas_data.benchmarks.blind.draw import draw_case
from nas_data.benchmarks.blind.grade import grade_names
from nas_data.benchmarks.blind.motions import MIXTURE, SIGNALS
from nas_data.benchmarks.blind.settings import xl320
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.settings.xl320 import QUANTUM
from nas_data.benchmarks.blind.write import DATASET, write_case
from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.errors import UnknownName
from nas_data.typed_json import as_object

# of `fingerprint`, computed before there were settings; that of `outside` when it had eight causes
BEFORE = [
    pytest.param(("none", "numpy", 0, 11), "ed6a2e6bfa971089", marks=pytest.mark.slow),
    (("none", "mujoco", 2, 11), "d6a7f43edfc1f7da"),  # what is hidden there is ours, and may become more exact
    pytest.param(("one", "numpy", 1, 11), "5ce12b0927f20eb7", marks=pytest.mark.slow),
    pytest.param(("two", "numpy", 2, 11), "2922a59b9ea72931", marks=pytest.mark.slow),
    pytest.param(("three", "numpy", 0, 11), "3bfcaa65c35fd586", marks=pytest.mark.slow),
    pytest.param(("outside", "numpy", 3, 11), "888ecd7e4f1fe27c", marks=pytest.mark.slow),
    pytest.param(("one", "bullet", 0, 11), "7140c84926ada8b3", marks=[pytest.mark.bullet, pytest.mark.slow]),
]


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    shorten(monkeypatch)


def fingerprint(case: Case) -> str:
    """Return a hash of all that is drawn: names, numbers to six digits, commands, readings in quanta."""
    answer = as_object(case.answer())
    told = [rounded(answer[key]) for key in ("case", "arm", "joints", "excitation", "effects", "base")]
    digest = hashlib.sha256(json.dumps(told).encode())
    if case.arm.name == "random_arm":
        digest.update(case.arm.xml.encode())
    for episodes in (case.recorded, case.fresh):
        digest.update(episodes.commands.astype(np.float32).tobytes())
        digest.update(episodes.poses.astype(np.float32).tobytes())
        digest.update(np.round(episodes.readings / QUANTUM).astype(np.int32).tobytes())
    return digest.hexdigest()[:16]


def rounded(value):
    """Return JSON whose numbers have six digits."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


@pytest.mark.parametrize(("name", "before"), BEFORE)
def test_the_default_setting_draws_what_it_drew_before_there_were_others(name, before, monkeypatch):
    monkeypatch.setattr(xl320, "SETTING", replace(xl320.SETTING, screen="numpy"))  # as it is where no test shortens
    assert fingerprint(draw_case(*name)) == before


def test_every_setting_can_be_found_and_no_other():
    assert registry.list_names("benchmarks.blind.settings") == ("any", "far", "poor", "small", "torque", "xl320")
    with pytest.raises(UnknownName, match="setting"):
        draw_case("none", "numpy", 0, 0, setting="all")
    with pytest.raises(UnknownName, match="setting"):
        BlindPlan(("none",), ("numpy",), 1, 0, setting="all").check()


def test_other_cases_have_names_of_their_own():
    names = {Identity("one", "numpy", 0, 0, setting=setting).name for setting in ("any", "xl320")}
    assert names == {"any-one-numpy-0-0000", "one-numpy-0-0000"}


@pytest.mark.slow
@pytest.mark.parametrize("family", ["none", "one", "two", "three", "outside"])
def test_other_cases_hide_what_can_be_seen_and_is_not_huge(family, tmp_path):
    case = draw_case(family, "numpy", 1, 3, setting="any")
    assert all(4 <= mark <= 60 for mark in case.marks)
    write_case(case, tmp_path / "case")
    assert verify(tmp_path / "case" / DATASET) == []
    dataset, sensor = read(tmp_path / "case" / DATASET), case.conditions.sensor
    assert dataset.fps == case.conditions.rate and dataset.joints == case.arm.joints
    noise = np.sqrt(np.square(case.recorded.readings - case.recorded.positions).mean())
    assert noise == pytest.approx(sensor.floor, rel=0.15)


@pytest.mark.slow
def test_measured_speeds_are_handed_over_and_others_differenced(tmp_path):
    sorts = {}
    for number in range(12):
        _, conditions, *_ = drawn(number)
        sorts.setdefault(conditions.sensor.speed_noise is None, number)
    for differenced, number in sorts.items():
        case = draw_case("none", "numpy", number, 5, setting="any")
        write_case(case, tmp_path / str(number))
        dataset, n = read(tmp_path / str(number) / DATASET), len(case.arm.joints)
        row = dataset.episode(1).start + 7
        backward = (dataset.states[row, :n] - dataset.states[row - 1, :n]) * case.conditions.rate
        assert np.allclose(dataset.states[row, n:], backward, atol=1e-3) == differenced
        assert (case.recorded.speeds is None) == differenced
    assert len(sorts) == 2


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow]),
        pytest.param("numpy", marks=pytest.mark.slow),
        pytest.param("mujoco", marks=pytest.mark.slow),
    ],
)
def test_who_knows_everything_is_right_about_other_arms_too(plant, tmp_path):
    plan = BlindPlan(("one",), (plant,), 1, 4, setting="any")
    said: list[str] = []
    records = run(plan, tmp_path, know_everything, said.append)
    for record in records:
        assert record["setting"] == "any" and record["exact"], record
        # at first the model does not know what its plant was told before, and these episodes are short
        assert record["fresh"]["after"] < record["fresh"]["floor"] + 0.3 * record["fresh"]["before"], record
    assert run(plan, tmp_path, know_everything, said.append) == records and len(said) == 1


def test_poor_data_are_five_slow_episodes_of_one_sort():
    signals = set()
    for number in range(20):
        identity = Identity("none", "numpy", number, 3, setting="poor")
        _, conditions = find_setting("poor").draw(identity)
        assert conditions.rate == 20 and conditions.episodes == 5
        signals.add(conditions.signal)
    assert signals == set(SIGNALS) - {MIXTURE}


@pytest.mark.slow
def test_a_case_of_poor_data_is_a_sound_dataset(tmp_path):
    case = draw_case("none", "numpy", 0, 3, setting="poor")
    write_case(case, tmp_path / "case")
    assert verify(tmp_path / "case" / DATASET) == []
    assert read(tmp_path / "case" / DATASET).n_episodes == 5


@pytest.mark.parametrize(
    ("family", "setting", "plant"),
    [
        ("every", "xl320", "mujoco"),
        pytest.param("every", "xl320", "numpy", marks=pytest.mark.slow),
        pytest.param("one", "poor", "numpy", marks=pytest.mark.slow),
        pytest.param("every", "any", "numpy", marks=pytest.mark.slow),
        pytest.param("every", "torque", "numpy", marks=pytest.mark.slow),
    ],
)
def test_who_knows_everything_is_right_about_those_cases_too(family, setting, plant, tmp_path):
    plan = BlindPlan((family,), (plant,), 1, 4, setting=setting)
    found = run(plan, tmp_path, know_everything, lambda line: None)[0].outcome
    assert found.grade.exact and found.grade.verdict_right, found
    assert found.fresh.after < found.fresh.floor + 0.3 * found.fresh.before, found


@pytest.mark.slow
@pytest.mark.parametrize("setting", ["any", "far", "poor", "torque"])
def test_every_baseline_answers_on_other_arms(setting, tmp_path, monkeypatch):
    small = {"updates": 1, "frames": 50, "horizon": 10, "hidden": 8, "shortcut": False}
    monkeypatch.setattr("nas_data.benchmarks.blind.baselines.phi.SMALL", small)
    names = registry.list_names("benchmarks.blind.baselines")
    plan = BlindPlan(("one",), ("numpy",), 1, 4, baselines=names, setting=setting)
    record = run(plan, tmp_path, know_everything, print)[0]
    for name in names:
        assert record.baselines[name].outcome.fresh.after is not None, record.baselines[name]


def test_a_place_that_is_not_reported_is_the_centre_of_mass():
    hidden = {"effect": "payload", "joint": None, "parameters": {"mass": 0.2, "x": 0.03, "y": 0.0, "z": 0.04}}
    answer = answered([hidden])
    found = grade_names(answer, report_of([entry_of("payload", None, {"mass": 0.2})], "explained"))
    errors = {row.parameter: row.relative_error for row in found.parameters}
    assert errors == pytest.approx({"mass": 0.0, "x": 0.6, "y": 0.0, "z": 0.8})


def test_the_command_knows_its_settings(capsys, tmp_path):
    assert main(["benchmark", "gap", "--setting", "all", "--out", str(tmp_path)]) == 2
    with pytest.raises(SystemExit):
        main(["benchmark", "gap", "--help"])
    told = capsys.readouterr().out
    assert all(name in told for name in ("--setting", *registry.list_names("benchmarks.blind.settings")))
