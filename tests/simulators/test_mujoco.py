"""The batched simulator is MuJoCo, bit for bit: one-step predictions, rollouts and closed loops equal a plain loop."""

import hashlib
import math
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.simulator_samples import (
    CONTACTS,
    GRIPPER,
    PLAY,
    SLOW_DEAF,
    SO101,
    model_at,
    motors,
    needs_so101,
    play_loop,
    predict_loop,
)

from nas_data.effects.backlash import Backlash
from nas_data.effects.load_friction import LoadFriction
from nas_data.errors import ModelFileError
from nas_data.robots.base import find_robot
from nas_data.runs.parallel import count_cores
from nas_data.simulators import mujoco as simulator_module
from nas_data.simulators.mujoco import MujocoSimulator

MODELS = ("ergojr", "pendulum", "contacts", "gripper", "motors", pytest.param("so101", marks=needs_so101))
PERIODS = {"ergojr": 0.01, "pendulum": 0.005, "contacts": 0.02, "gripper": 0.02, "motors": 0.01, "so101": 1 / 49.85}
FILES = {"contacts": CONTACTS, "gripper": GRIPPER, "motors": motors(), "play": PLAY, "slow": SLOW_DEAF}
JOINTS = {"gripper": ("b", "a")}  # another order than the model's, and one joint less


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models")
    for name, text in FILES.items():
        (path / f"{name}.xml").write_text(text)
    return path


def load(folder: Path, name: str, **options) -> tuple[MujocoSimulator, Path]:
    """Return a simulator on one thread and the file that plain MuJoCo can read."""
    path = SO101 if name == "so101" else folder / f"{name}.xml" if name in FILES else find_robot(name).mjcf
    options = {"threads": 1, "joints": JOINTS.get(name)} | options
    return MujocoSimulator.load(path, options.pop("period", PERIODS.get(name, 0.02)), **options), path


def draw(simulator: MujocoSimulator, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return states (count, 2n) and commands (count, n) within what a robot does."""
    n = len(simulator.joints)
    rng = np.random.default_rng(seed)
    positions, speeds = rng.uniform(-0.8, 0.8, (count, n)), rng.uniform(-2, 2, (count, n))
    return np.concatenate([positions, speeds], axis=1), rng.uniform(-0.8, 0.8, (count, n))


@pytest.mark.parametrize("name", MODELS)
def test_predictions_equal_a_plain_loop_bit_for_bit(folder, name):
    simulator, path = load(folder, name)
    states, commands = draw(simulator, 12)
    expected = predict_loop(path, simulator.period, simulator.joints, states, commands)
    assert np.array_equal(simulator.predict(states, commands), expected)
    # what datasets hold is float32
    rough = states.astype(np.float32), commands.astype(np.float32)
    expected = predict_loop(path, simulator.period, simulator.joints, *rough)
    assert np.array_equal(simulator.predict(*rough), expected)


@pytest.mark.parametrize("name", MODELS)
def test_rollouts_equal_a_plain_loop_bit_for_bit(folder, name):
    simulator, path = load(folder, name)
    initial, _ = draw(simulator, 3, seed=1)
    commands = np.repeat(draw(simulator, 3 * 4, seed=2)[1].reshape(3, 4, -1), 8, axis=1)
    expected = [
        play_loop(path, simulator.period, simulator.joints, state, row)
        for state, row in zip(initial, commands, strict=True)
    ]
    assert np.array_equal(simulator.rollout(initial, commands), expected)


@pytest.mark.parametrize("name", MODELS)
def test_a_closed_loop_equals_a_rollout_bit_for_bit(folder, name):
    simulator, _ = load(folder, name)
    initial, _ = draw(simulator, 3, seed=1)
    commands = draw(simulator, 3 * 25, seed=2)[1].reshape(3, 25, -1)
    stepper = simulator.stepper(3)
    stepper.reset(initial)
    states = np.stack([stepper.step(commands[:, step]).copy() for step in range(25)], axis=1)
    assert np.array_equal(states, simulator.rollout(initial, commands))


@pytest.mark.parametrize("effects", [(), (Backlash(joint="m3", half_width=0.02),)], ids=["plain", "backlash"])
def test_results_depend_neither_on_threads_nor_on_chunks(effects, monkeypatch):
    one = MujocoSimulator.load("ergojr", 0.01, effects=effects, threads=1)
    two = MujocoSimulator.load("ergojr", 0.01, effects=effects, threads=2)
    states, commands = draw(one, 40)
    episodes = np.repeat(commands.reshape(8, 5, -1), 3, axis=1)
    predicted, rolled = one.predict(states, commands), one.rollout(states[:8], episodes)
    assert np.array_equal(two.predict(states, commands), predicted)
    assert np.array_equal(two.rollout(states[:8], episodes), rolled)
    monkeypatch.setattr(simulator_module, "CHUNK_STATES", 1000)
    for simulator in (one, two):
        assert np.array_equal(simulator.predict(states, commands), predicted)
        assert np.array_equal(simulator.rollout(states[:8], episodes), rolled)
    backwards = one.predict(states[::-1], commands[::-1])[::-1]
    assert np.array_equal(backwards, predicted)


def test_a_system_that_does_not_restrict_processes_to_cores_uses_all_of_them(monkeypatch):
    """macOS is one."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert count_cores() == 3
    assert MujocoSimulator.load("pendulum", 0.005).threads == 3


def test_nothing_to_simulate_is_no_error():
    pendulum = MujocoSimulator.load("pendulum", 0.005, threads=1)
    assert pendulum.predict(np.zeros((0, 2)), np.zeros((0, 1))).shape == (0, 2)
    assert pendulum.rollout(np.zeros((0, 2)), np.zeros((0, 4, 1))).shape == (0, 4, 2)
    assert pendulum.rollout(np.zeros((3, 2)), np.zeros((3, 0, 1))).shape == (3, 0, 2)


@settings(max_examples=25, deadline=None)
@given(rate=st.floats(1.0, 900.0))
def test_whole_steps_no_longer_than_the_models_fill_any_period(rate):
    simulator = MujocoSimulator.load("pendulum", 1 / rate, threads=1)
    original = find_robot("pendulum").spec().option.timestep
    assert simulator.substeps * simulator.model.opt.timestep == pytest.approx(1 / rate, rel=1e-12)
    assert simulator.model.opt.timestep <= original * (1 + 1e-5)
    assert (simulator.substeps - 1) * original < 1 / rate * (1 + 1e-5), "shorter than needed"


@needs_so101
def test_the_rate_of_the_real_recordings_shortens_the_timestep():
    simulator = MujocoSimulator.load(SO101, 1 / 49.85, threads=1)
    assert simulator.substeps == 11
    assert simulator.model.opt.timestep == pytest.approx(1 / 49.85 / 11)
    assert simulator.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
    assert simulator.describe()["timestep"] == simulator.model.opt.timestep


def test_a_period_that_the_timestep_divides_leaves_it_alone():
    simulator = MujocoSimulator.load("ergojr", 0.01, threads=1)
    assert (simulator.substeps, simulator.model.opt.timestep) == (5, 0.002)


# states: set, read, and kept memories


@pytest.mark.parametrize("name", ["ergojr", "play", "slow", "gripper", "contacts"])
def test_states_read_what_was_set(folder, name):
    simulator, _ = load(folder, name)
    states, commands = draw(simulator, 5)
    stepper = simulator.stepper(5)
    stepper.reset(states)
    assert np.array_equal(stepper.states, states)
    for _ in range(7):
        stepper.step(commands)
    stepper.set_states(states[::-1])
    np.testing.assert_allclose(stepper.states, states[::-1], rtol=0, atol=1e-14)


def test_resetting_some_rows_leaves_the_others_as_they_are(folder):
    simulator, _ = load(folder, "slow")
    states, commands = draw(simulator, 4)
    stepper, alone = simulator.stepper(4), simulator.stepper(4)
    for batch in (stepper, alone):
        batch.reset(states)
        for _ in range(5):
            batch.step(commands)
    stepper.reset(states[[2, 0]], rows=np.array([0, 2]))
    assert np.array_equal(stepper.states[[0, 2]], states[[2, 0]])
    assert np.array_equal(stepper.states[[1, 3]], alone.states[[1, 3]])
    fresh = simulator.stepper(2)
    fresh.reset(states[[2, 0]])
    for _ in range(5):  # delay lines and setpoints of the rows that were reset are as new, those of the others go on
        after, going_on, new = stepper.step(commands), alone.step(commands), fresh.step(commands[[0, 2]])
        assert np.array_equal(after[[1, 3]], going_on[[1, 3]])
        assert np.array_equal(after[[0, 2]], new)


def test_setting_states_keeps_play_delays_and_setpoints(folder):
    simulator, _ = load(folder, "play")
    stepper = simulator.stepper(1)
    stepper.reset(np.zeros((1, 2)))
    for _ in range(20):
        stepper.step(np.full((1, 1), 0.5))
    play = stepper.batch.bind("qpos")[0, 1]
    assert abs(play) > 0.04, "gravity should lean the link on one side of its play"
    stepper.set_states(np.array([[0.3, 0.0]]))
    assert stepper.batch.bind("qpos")[0, 1] == play
    slow, _ = load(folder, "slow")
    stepper = slow.stepper(1)
    stepper.reset(np.zeros((1, 4)))
    stepper.step(np.array([[0.0, 0.4]]))  # this command is under way for 30 ms
    stepper.set_states(np.zeros((1, 4)))
    assert stepper.step(np.zeros((1, 2)))[0, 3] > 0.05


@pytest.mark.parametrize("effect", [Backlash(joint="m3", half_width=0.03), LoadFriction(joint="m2", ratio=0.3)])
def test_looking_at_a_closed_loop_changes_nothing(effect):
    simulator = MujocoSimulator.load("ergojr", 0.01, effects=(effect,), threads=1)
    watched, alone = simulator.stepper(3), simulator.stepper(3)
    rng = np.random.default_rng(0)
    for step in range(60):
        commands, change = rng.uniform(-1, 1, (3, 6)), 0.01 * rng.normal(size=(3, 12))
        after = [stepper.step(commands) for stepper in (watched, alone)]
        assert np.array_equal(*after)
        watched.site_positions("tip")
        for stepper in (watched, alone):
            if step % 3 == 0:  # also right after the sites were looked at
                stepper.set_states(after[0] + change)
            if step % 20 == 7:
                stepper.reset(np.zeros((1, 12)), np.array([1]))
        if step % 2:
            watched.site_positions("tip")
        assert np.array_equal(watched.states, alone.states)


def test_states_belong_to_whom_they_are_given(folder):
    stepper = load(folder, "ergojr")[0].stepper(2)
    stepper.states[:] = 7.0
    assert not stepper.states.any()


def test_setting_a_state_that_it_has_changes_nothing(folder):
    for name in ("ergojr", "contacts"):
        simulator, _ = load(folder, name)
        initial, commands = draw(simulator, 2)
        touched, left_alone = simulator.stepper(2), simulator.stepper(2)
        touched.reset(initial)
        left_alone.reset(initial)
        for _ in range(10):
            touched.step(commands)
            touched.set_states(touched.states)
            assert np.array_equal(touched.states, left_alone.step(commands))


def test_what_is_measured_is_servo_plus_play(folder):
    simulator, path = load(folder, "play")
    stepper = simulator.stepper(1)
    stepper.reset(np.array([[0.2, 0.0]]))
    model, steps = model_at(path, simulator.period)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.2
    for command in (0.5, 0.5, -0.3, -0.3):
        data.ctrl[0] = command
        for _ in range(steps):
            mujoco.mj_step(model, data)
        state = stepper.step(np.array([[command]]))[0]
        assert state[0] == data.qpos[0] + data.qpos[1]
        assert state[1] == data.qvel[0] + data.qvel[1]
        mujoco.mj_fwdPosition(model, data)
        assert state[0] == pytest.approx(data.ten_length[0], abs=1e-15)
        np.testing.assert_allclose(stepper.site_positions("end")[0], data.site("end").xpos, atol=1e-15)


def test_sites_follow_the_state_that_was_set():
    simulator = MujocoSimulator.load("pendulum", 0.005, threads=1)
    stepper = simulator.stepper(2)
    stepper.step(np.full((2, 1), 1.0))
    stepper.set_states(np.array([[0.0, 0.0], [math.pi / 2, 0.0]]))
    down, aside = stepper.site_positions("tip")
    assert np.linalg.norm(down - [0, 0, 0.15]) < 1e-12
    assert aside[2] == pytest.approx(0.25, abs=1e-12)
    assert abs(aside[0]) == pytest.approx(0.1, abs=1e-12)
    with pytest.raises(ModelFileError, match="nose"):
        stepper.site_positions("nose")


# memories start settled


@settings(max_examples=20, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_a_model_with_memory_stays_where_it_is_commanded_to_be(tmp_path_factory, a, b):
    path = tmp_path_factory.getbasetemp() / "settled.xml"
    path.write_text(SLOW_DEAF)
    simulator = MujocoSimulator.load(path, 0.02, threads=1)
    pose = np.array([[a, b]])
    initial = np.concatenate([pose, np.zeros((1, 2))], axis=1)
    states = simulator.rollout(initial, np.repeat(pose[:, None], 30, axis=1))
    np.testing.assert_allclose(states[0], np.repeat(initial, 30, axis=0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(simulator.predict(initial, pose), initial, rtol=0, atol=1e-12)
    stepper = simulator.stepper(1)
    stepper.reset(initial)
    for _ in range(10):
        np.testing.assert_allclose(stepper.step(pose), initial, rtol=0, atol=1e-12)


def test_a_late_command_acts_late_and_a_slewing_goal_ramps_from_the_posture(folder):
    simulator, _ = load(folder, "slow", period=0.01)
    initial = np.array([[0.7, -0.4, 0.0, 0.0]])
    commands = np.repeat(np.array([[[1.7, 0.1]]]), 60, axis=1)
    states = simulator.rollout(initial, commands)[0]
    np.testing.assert_allclose(states[:3], np.repeat(initial, 3, axis=0), rtol=0, atol=1e-12)
    assert states[4, 1] > -0.4 + 1e-4
    speed = states[30:50, 2]  # 1 rad at 1 rad/s: the goal is still under way
    assert speed == pytest.approx(1.0, abs=0.02)
    lag = 4 / 0.15  # [1/s] of kp over kv: the joint follows its goal by kv/kp seconds
    assert states[40, 0] == pytest.approx(0.7 + (0.41 - 0.03) - 1 / lag, abs=0.005)


def test_joints_that_the_dataset_lacks_are_held_at_their_reference(folder):
    simulator, _ = load(folder, "gripper", joints=("a",))
    assert simulator.joints == ("a",)
    stepper = simulator.stepper(1)
    stepper.reset(np.array([[0.3, 0.0]]))
    for _ in range(50):
        stepper.step(np.array([[0.3]]))
    qpos = stepper.batch.bind("qpos")[0]
    assert qpos[:3].tolist() == pytest.approx([0.3, 0.0, 0.4], abs=1e-9)


def test_a_source_describes_itself_for_provenance(folder):
    simulator, path = load(folder, "slow", effects=(Backlash(joint="b", half_width=0.02),))
    described = simulator.describe()
    assert described["name"] == "slow"
    assert described["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (described["engine"], described["engine_version"]) == ("mujoco", mujoco.__version__)
    assert described["effects"][0]["effect"] == "backlash"
    assert described["effects"][0]["parameters"]["half_width"] == {"value": 0.02, "unit": "rad"}
