"""Errors of the model that a baseline with the same motion has, too, are subtracted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nas_data as nas
from nas_data.effects.base import parse
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.name import name
from nas_data.gap.problem import Problem
from nas_data.gap.repeated_motion import RepeatedMotion, find_same_commands
from nas_data.gap.usual_error import UsualError
from nas_data.simulators.mujoco import MujocoSimulator

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body><joint name="lift" axis="0 1 0" damping=".05" armature=".01"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".015" mass=".2"/></body></worldbody>
<actuator><position name="lift" joint="lift" kp="12" kv=".4"/></actuator></mujoco>"""
WORN = "stribeck_friction:joint=lift,torque=0.35,kinetic_ratio=0.35,stribeck_velocity=0.3"  # what the model lacks
RATE, ROWS, EPISODES, NOISE = 50, 100, 6, 3e-4


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("repeated") / "arm.xml"
    path.write_text(ARM)
    return path


def record(file: Path, noise: int, *changes: str, motion: int = 0) -> nas.Dataset:
    """Record the worn arm from rest; `motion` and `noise` are seeds."""
    simulator = MujocoSimulator.load(file, 1 / RATE, effects=[*map(parse, (WORN, *changes))], threads=1)
    commands = np.random.default_rng(motion).uniform(-0.9, 0.9, (EPISODES, ROWS // 10, 1)).repeat(10, axis=1)
    commands[:, :5] = 0.0
    states = simulator.rollout(np.zeros((EPISODES, 2)), commands)
    positions = np.concatenate([np.zeros((EPISODES, 1, 1)), states[..., :1]], axis=1)
    positions += np.random.default_rng(noise).normal(0.0, NOISE, positions.shape)
    return nas.Dataset.from_arrays(positions, commands, rate=RATE, joints=("lift",))


def find_repeated(after: nas.Dataset, before: nas.Dataset, file: Path) -> RepeatedMotion:
    one, other = Problem.of(after, file, None), Problem.of(before, file, None)
    return RepeatedMotion.find(one.train, replace(other.train, evidence=other.evidence))


def test_a_change_that_is_smaller_than_the_errors_of_the_model_is_named(file: Path):
    changed = record(file, 2, "joint_offset:joint=lift,offset=0.005")
    before, after = (Problem.of(dataset, file, None) for dataset in (record(file, 1), changed))
    alone = before.train.settle()
    assert np.sqrt(alone.mean_squares(alone.roll_out(alone.evidence, (), {})).mean()) > 2 * 0.005
    compared = after.compare_with(before)
    (finding,) = name(compared.train, compared.held, contrast=compared.contrast).findings
    assert (finding.effect.name(), finding.effect.joint) == ("joint_offset", "lift")
    assert finding.effect.offset == pytest.approx(0.005, rel=0.1)
    assert compared.subtracts_baseline
    assert "6 of 6 episodes repeat a motion of the baseline" in " ".join(compared.as_given.known)


def test_errors_of_the_same_motion_are_alike_and_of_another_motion_are_not(file: Path):
    before = record(file, 1)
    same, other = (find_repeated(record(file, 2, motion=motion), before, file) for motion in (0, 1))
    assert same.correlation.min() > 0.99
    assert np.sqrt((same.errors**2).mean()) > 20 * NOISE
    assert not other.correlation.any() and not other.errors.any()


def test_the_more_the_motion_changes_the_less_errors_are_alike(file: Path):
    before = record(file, 1)
    shares = [
        find_repeated(record(file, 2, f"servo_stiffness:joint=lift,factor={factor}"), before, file).correlation.mean()
        for factor in (1.1, 1.5, 4.0)
    ]
    assert 1 > shares[0] > shares[1] > shares[2] > 0


@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_the_noise_of_a_copy_is_not_subtracted(file: Path, shift: float):
    before = record(file, 1)
    columns = {key: column + shift * (key != "action") for key, column in before.columns.items()}
    copy = replace(before, columns=columns)
    assert not find_repeated(copy, before, file).correlation.any()


def test_a_baseline_at_another_rate_has_no_row_of_the_motion(file: Path):
    before = record(file, 1)
    repeated = find_repeated(record(file, 2), replace(before, fps=2 * before.fps), file)
    assert not repeated.correlation.any()


def test_rows_that_a_shorter_baseline_lacks_are_left_out(file: Path):
    before, after = (Problem.of(record(file, noise), file, None) for noise in (1, 2))
    short = before.evidence.first(ROWS - 5)
    repeated = RepeatedMotion.find(after.train, replace(before.train, evidence=short))
    usual = UsualError(np.array([0.01]), np.array([0.0]), after.train.floor)
    mask = repeated.subtract(after.train, usual).evidence.mask
    assert repeated.is_alike.all()
    assert mask[:, :-5].all() and not mask[:, -5:].any()


@pytest.mark.parametrize("jitter", [0.0, 1e-3])
def test_a_joint_that_is_held_does_not_hide_that_a_motion_is_the_same(jitter: float):
    rng = np.random.default_rng(0)
    moved = rng.uniform(-1, 1, (3, 40, 1)).repeat(5, axis=1)
    one, other = (
        EpisodeBatch(("a", "b"), 0.02, np.zeros((3, 2)), commands, commands, np.ones((3, 200), bool), np.arange(3))
        for commands in (np.concatenate([moved, jitter * rng.normal(size=moved.shape)], axis=2) for _ in range(2))
    )
    assert [find_same_commands(one, number, other) for number in range(3)] == [0, 1, 2]
