"""Comparison with a baseline: only what differs from an earlier recording is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nas_data.api.gap import identify
from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.errors import JointMismatch
from nas_data.gap.floor import compute_floor_ratios
from nas_data.gap.nominal_parameters import FITTED_TOLERANCE, TOLERANCE
from nas_data.gap.problem import Problem
from nas_data.gap.search.intervals import find_existing_deviation
from nas_data.gap.usual_error import UsualError
from nas_data.gap.write_model import MODEL, write_effects

WORN = "coulomb_friction:joint=pendulum,torque=0.05"  # what the arm has and the model lacks
SOFT = "servo_stiffness:joint=pendulum,factor=0.6"  # what is changed


def record(folder: Path, *effects: str) -> Path:
    options = [word for effect in effects for word in ("--effect", effect)]
    command = ["record", "sim", "--robot", "pendulum", *options, "--noise", "0.0009", "--out", str(folder)]
    assert main([*command, "--episodes", "6", "--seconds", "1.5"]) == 0
    return folder


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("baseline") / "before", WORN)


@pytest.fixture(scope="module")
def after(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("baseline") / "after", WORN, SOFT)


@pytest.fixture(scope="module")
def described(before: Path) -> Path:
    """Model with the baseline's effect, as `nas gap` makes it of the baseline."""
    effects, out = write_effects(before.parent, [parse(WORN)], {}), before.parent / "gap"
    words = ["gap", "add", before, "--model", "pendulum", "--effects", effects, "--out", out]
    assert main(list(map(str, words))) == 0
    return out / MODEL


def compute_ratios(problem: Problem) -> np.ndarray:
    tasks = problem.train.settle(), problem.held.settle()
    squares = np.concatenate([task.mean_squares(task.roll_out(task.evidence, (), {})) for task in tasks])
    return compute_floor_ratios(squares, np.concatenate([task.floors for task in tasks]))


def test_a_baseline_has_errors_as_large_as_expected(before: Path):
    alone = Problem.load(before, "pendulum")
    assert compute_ratios(alone)[0] > 3
    compared = alone.compare_with(alone)
    assert compute_ratios(compared) == pytest.approx(1.0, abs=0.15)
    assert compared.train.floor == pytest.approx(alone.train.floor)
    assert {parameter.tolerance for parameter in compared.held.nominal.base} == {FITTED_TOLERANCE}


def test_only_what_differs_from_the_baseline_is_named(before: Path, after: Path, described: Path, tmp_path: Path):
    report = identify(after, described, out=tmp_path / "gap", baseline=before)
    assert [(effect.name, effect.joint) for effect in report.effects] == [("servo_stiffness", "pendulum")]
    assert report.effects[0].parameters["factor"].value == pytest.approx(0.6, rel=0.05)
    assert f"--baseline {before}" in report.made_from.command


@pytest.mark.slow
def test_what_explains_the_baseline_too_is_not_named(before: Path, after: Path, tmp_path: Path):
    """The model lacks the friction of both recordings."""
    report = identify(after, "pendulum", out=tmp_path / "gap", baseline=before)
    assert [(effect.name, effect.joint) for effect in report.effects] == [("servo_stiffness", "pendulum")]
    assert not identify(before, "pendulum", out=tmp_path / "same", baseline=before).effects


@pytest.mark.slow
def test_the_baseline_itself_has_no_gap(before: Path, described: Path, tmp_path: Path):
    report = identify(before, described, out=tmp_path / "gap", baseline=before)
    assert report.verdict == "none" and not report.effects


def test_a_baseline_has_the_joints_of_the_recording(before: Path, capsys: pytest.CaptureFixture[str]):
    other = before.parent / "other"
    assert main(["record", "sim", "--robot", "ergojr", "--episodes", "2", "--seconds", "1", "--out", str(other)]) == 0
    command = ["gap", str(before), "--model", "pendulum", "--baseline", str(other), "--out", str(before.parent / "no")]
    assert main(command) != 0
    error = capsys.readouterr().err
    assert "'m1'" in error and f"The baseline {other}" in error
    compared = Problem.load(before, "pendulum")
    with pytest.raises(JointMismatch, match="same joints"):
        compared.compare_with(Problem.load(other, "ergojr"))


def test_what_the_model_has_is_better_known_beside_a_baseline(before: Path):
    alone, effect = Problem.load(before, "pendulum"), parse("viscous_friction:joint=pendulum,coefficient=0.01")
    compared = alone.compare_with(alone)
    known, supposed = (
        find_existing_deviation(problem.train, effect, effect.parameters[0]) for problem in (compared, alone)
    )
    assert 0 < known == pytest.approx(FITTED_TOLERANCE / TOLERANCE * supposed)


def test_the_usual_error_grows_with_the_motion_and_is_no_less_than_noise():
    rng = np.random.default_rng(0)
    motions = np.stack([rng.uniform(0.0, 0.5, 400), np.zeros(400)], axis=1)
    true = np.hypot([0.004, 0.0005], [0.05, 0.0] * motions)
    errors = true * np.abs(rng.normal(1.0, 0.1, true.shape))
    usual = UsualError.fit(errors, motions, np.array([0.001, 0.001]))
    expected = np.hypot(usual.predict(motions), usual.floor)
    assert expected[:, 0] == pytest.approx(true[:, 0], rel=0.1)
    assert expected[:, 1] == pytest.approx(0.001)


def test_episodes_in_which_a_joint_rests_do_not_hide_others():
    """A third with sixteen times the floor, the rest with a hundredth."""
    squares = np.array([[16.0], [0.01], [0.01]]) ** 2
    assert compute_floor_ratios(squares, np.array([1.0]))[0] > 2
    assert compute_floor_ratios(np.ones((3, 1)), np.ones((3, 1))) == pytest.approx(1.0)
    assert compute_floor_ratios(np.array([[1.0]] * 19 + [[1e6]]), np.array([1.0]))[0] < 2.5


def test_the_usual_error_of_each_episode_is_selected_with_it(before: Path):
    task = Problem.load(before, "pendulum").train
    errors = np.arange(1.0, 1 + task.floors.size).reshape(task.floors.shape)
    part = replace(task, usual_error=errors).select([2, 0])
    assert part.tolerance == pytest.approx(task.floor**2 + errors[[2, 0]] ** 2)
