"""Simulated recordings hold what a robot would have reported, and say where they come from."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data.cli import main
from nas_data.command_file import read_commands, write_commands
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.errors import JointMismatch, LogError, OptionError
from nas_data.recorders.readings import Readings
from nas_data.robots.base import FOLDER, find_robot
from nas_data.simulators.mujoco import MujocoSimulator

JOINTS = find_robot("ergojr").joints
QUANTUM = find_robot("ergojr").position_quantum


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(*options: str, out: str = "recorded") -> tuple[Dataset, Provenance]:
    assert main(["record", "sim", "--episodes", "4", "--seconds", "1", "--out", out, *options]) == 0
    provenance = read_provenance(Path(out))
    assert provenance is not None
    return read(Path(out)), provenance


def refused(capsys, *options: str) -> str:
    assert main(["record", "sim", "--episodes", "2", "--seconds", "0.5", "--out", "refused", *options]) == 2
    assert not Path("refused").exists()
    assert not Path("datasets").exists()
    return capsys.readouterr().err


def test_a_recording_is_a_sound_dataset_with_its_history(folder, capsys):
    dataset, provenance = record("--effect", "backlash:joint=m3,half_width=0.02", "--noise", "0.001", "--json")
    answer = json.loads(capsys.readouterr().out)
    assert answer["frames"] == dataset.n_frames == 400
    assert answer["content_hash"] == provenance.content_hash
    assert verify(Path("recorded")) == []
    assert dataset.joints == JOINTS
    assert dataset.fps == 100
    assert dataset.robot_type == "ergojr"
    assert provenance.how == "simulated"
    assert provenance.contiguous
    assert provenance.seeds == (0,)
    assert provenance.target["sha256"] == find_robot("ergojr").sha256
    assert provenance.target["effects"][0]["parameters"]["half_width"]["value"] == 0.02
    assert provenance.target["noise"] == 0.001
    assert provenance.signal["excitation"] == "steps"


def test_one_measured_sequence_gives_both_states(folder):
    dataset, _ = record("--noise", "0.01")
    for rows in dataset.episodes():
        assert np.array_equal(dataset.states[rows][1:], dataset.next_states[rows][:-1])
        assert dataset.columns["nas.time"][rows][:, 0] == pytest.approx(np.arange(100) / 100)


def test_readings_are_multiples_of_the_servo_s_units(folder):
    dataset, _ = record("--noise", "0.003")
    robot = find_robot("ergojr")
    for column, unit in ((slice(0, 6), robot.position_quantum), (slice(6, 12), robot.velocity_quantum)):
        counts = dataset.states[:, column].astype(float) / unit
        assert np.abs(counts - np.round(counts)).max() < 1e-3
        assert len(np.unique(np.round(counts))) > 20


def test_exact_readings_are_the_simulator_s_own(folder):
    """A recording without noise is a rollout from the first state: settled, then commanded."""
    dataset, _ = record("--quantum", "0")
    target = MujocoSimulator.load("ergojr", 0.01, threads=1)
    commands = dataset.commands.reshape(4, 100, 6).astype(float)
    held = np.zeros((4, 50, 6))
    states = target.rollout(np.zeros((4, 12)), np.concatenate([held, commands], axis=1))
    assert dataset.states.reshape(4, 100, 12)[:, 0] == pytest.approx(states[:, 49], abs=1e-6)
    assert dataset.next_states.reshape(4, 100, 12) == pytest.approx(states[:, 50:], abs=1e-4)


def test_episodes_start_settled_at_rest_or_in_random_poses(folder):
    rest, _ = record("--quantum", "0", out="rest")
    random, _ = record("--quantum", "0", "--start", "random", out="random")
    for dataset, spread in ((rest, 0.0), (random, 0.2 * math.pi / 2)):
        first = dataset.states[dataset.starts]
        assert np.abs(first[:, :6]).max() <= spread + math.radians(6)  # gravity and friction leave up to 6°
        assert np.abs(first[:, 6:]).max() < 0.02
    assert np.ptp(random.states[random.starts][:, :6], axis=0).min() > 0.02


def test_the_same_seed_gives_the_same_dataset_and_noise_leaves_the_commands_alone(folder):
    one, first = record("--seed", "7", "--noise", "0.002", out="a")
    _, again = record("--seed", "7", "--noise", "0.002", out="b")
    louder, _ = record("--seed", "7", "--noise", "0.02", out="c")
    other, _ = record("--seed", "8", "--noise", "0.002", out="d")
    assert first.content_hash == again.content_hash
    repeated, _ = record("--seed", "7", "--noise", "0.002", "--noise-seed", "8", out="e")
    assert np.array_equal(one.commands, louder.commands) and np.array_equal(one.commands, repeated.commands)
    assert not np.array_equal(one.states, repeated.states)
    assert np.abs(one.states - repeated.states).max() < 0.02
    assert not np.array_equal(one.states, louder.states)
    assert not np.array_equal(one.commands, other.commands)


def test_blind_recordings_keep_the_effects_but_do_not_tell(folder):
    told, provenance = record("--effect", "speed_limit:joint=m2,speed=1.5", out="told")
    hidden, blind = record("--effect", "speed_limit:joint=m2,speed=1.5", "--blind", out="hidden")
    assert np.array_equal(told.states, hidden.states)
    assert provenance.target["effects"]
    assert "effects" not in blind.target
    everything = "".join(path.read_text() for path in Path("hidden/meta").glob("*.json"))
    assert "speed_limit" not in everything


def test_effects_come_from_files_and_words_together(folder):
    Path("effects.json").write_text(json.dumps([{"effect": "payload", "parameters": {"mass": 0.02}}]))
    _, provenance = record("--effects", "effects.json", "--effect", "base_tilt:roll=0.1,pitch=0")
    assert [entry["effect"] for entry in provenance.target["effects"]] == ["payload", "base_tilt"]


def test_versions_of_a_name_follow_each_other(folder, capsys):
    for seed in ("1", "2"):
        assert main(["record", "sim", "--robot", "pendulum", "--episodes", "1", "--seconds", "1", "--seed", seed]) == 0
    versions = sorted(path.name for path in Path("datasets/pendulum_steps").iterdir() if path.name.startswith("v"))
    assert [version[:3] for version in versions] == ["v1-", "v2-"]
    assert "Recorded 1 episode of pendulum" in capsys.readouterr().out


def test_a_command_file_is_played_as_it_is(folder):
    rng = np.random.default_rng(0)
    episodes = [rng.uniform(-1, 1, (steps, 6)) for steps in (30, 50, 20)]
    write_commands(Path("mine.csv"), [f"{joint}.pos" for joint in JOINTS], episodes)
    dataset, provenance = record("--commands", "mine.csv")
    assert dataset.lengths.tolist() == [30, 50, 20]
    assert dataset.commands == pytest.approx(np.concatenate(episodes), abs=1e-6)
    assert provenance.signal["file"] == "mine.csv"
    assert dataset.tasks == ("mine",) * 3


@settings(max_examples=20, deadline=None)
@given(st.lists(st.lists(st.floats(-10, 10), min_size=2, max_size=2), min_size=1, max_size=8), st.integers(1, 3))
def test_command_files_read_back_bit_by_bit(tmp_path_factory, rows, episodes):
    path = tmp_path_factory.mktemp("commands") / "commands.csv"
    commands = [np.array(rows)] * episodes
    write_commands(path, ["a.pos", "b.pos"], commands)
    back = read_commands(path, ["b.pos", "a.pos"])
    assert all(np.array_equal(one[:, ::-1], other) for one, other in zip(back, commands, strict=True))


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", LogError, "no commands"),
        ("a.pos\n", LogError, "no commands"),
        ("a.pos\nx\n", LogError, "line 2: a.pos is 'x'"),
        ("a.pos\n1\n\nnan\n", LogError, "'nan'"),
        ("a.pos\n1,2\n", LogError, "line 2 has 2 cells"),
        ("b.pos\n1\n", JointMismatch, "it needs a.pos"),
        ("a.pos,c.pos\n1,2\n", JointMismatch, "it needs a.pos"),
        ("a.pos,episode\n1,0\n1,1\n1,0\n", LogError, "not contiguous"),
    ],
)
def test_faulty_command_files_are_refused_by_row(tmp_path, text, error, words):
    path = tmp_path / "commands.csv"
    path.write_text(text)
    with pytest.raises(error, match=words):
        read_commands(path, ["a.pos"])


def test_torque_commands_are_recorded_as_torques(folder):
    Path("motor.xml").write_text(
        """<mujoco><worldbody><body><joint name="j" damping="0.1"/><geom size="0.05" pos="0.1 0 0"/></body></worldbody>
        <actuator><motor name="j" joint="j" ctrlrange="-0.5 0.5"/></actuator></mujoco>"""
    )
    dataset, _ = record("--robot", "motor.xml")
    assert set(dataset.kinds) == {".effort"}
    assert np.abs(dataset.commands).max() <= 0.5
    assert np.abs(dataset.states).max() > 0.01


@pytest.mark.parametrize("start", ["rest", "random"])
@pytest.mark.parametrize("actuator", ['<position joint="{}" kp="20" kv="1"/>', '<motor joint="{}" ctrlrange="-1 1"/>'])
def test_a_joint_whose_range_leaves_zero_out_starts_within_it(folder, actuator, start):
    """As the elbow of a Panda, which bends to one side only, and the fingers of a gripper that do not close."""
    Path("arm.xml").write_text(
        f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
        <joint name="a" axis="0 1 0" range="-1 1" damping="0.1"/><geom size="0.05" pos="0.1 0 0" mass="0.1"/>
        <body pos="0.2 0 0"><joint name="b" axis="0 1 0" range="-3 -0.5" damping="0.1"/>
        <geom size="0.05" pos="0.1 0 0" mass="0.1"/></body></body></worldbody>
        <actuator>{actuator.format("a")}{actuator.format("b")}</actuator></mujoco>"""
    )
    dataset, _ = record("--robot", "arm.xml", "--start", start, "--joints", "a")
    first = dataset.states[dataset.starts, :2]
    assert (first[:, 1] >= -3).all() and (first[:, 1] <= -0.5 + 1e-3).all()
    if dataset.kinds[1] == ".pos":
        assert dataset.commands[:, 1] == pytest.approx(-0.5)


def test_bad_input_is_one_sentence_and_writes_nothing(folder, capsys):
    assert "choose one of: ergo_shield, ergojr" in refused(capsys, "--robot", "r2d2")
    assert "no model file absent.xml" in refused(capsys, "--robot", "absent.xml")
    assert "choose one of: acceleration_limit" in refused(capsys, "--effect", "gremlins")
    assert "m1, m2" in refused(capsys, "--effect", "backlash:joint=m9,half_width=0.1")
    assert "choose one of: babbling" in refused(capsys, "--excitation", "wobble")
    assert "rate" in refused(capsys, "--rate", "0")
    assert "--rate is 1e-09; it must be in 0.01" in refused(capsys, "--rate", "1e-9")
    assert "noise is -1" in refused(capsys, "--noise", "-1")
    assert "at least one" in refused(capsys, "--episodes", "0")
    assert "effects.json" in refused(capsys, "--effects", "absent.json")
    assert "absent.csv" in refused(capsys, "--commands", "absent.csv")
    header = ",".join(f"{joint}.pos" for joint in JOINTS)
    Path("degrees.csv").write_text(f"{header}\n0,0,0,0,0,0\n0,45,0,0,0,0\n")
    message = refused(capsys, "--commands", "degrees.csv")
    assert "line 3: m2.pos is 45" in message
    assert "degrees" in message
    Path("endless.xml").write_text(
        """<mujoco><worldbody><body><joint name="j"/><geom size="0.05"/></body></worldbody>
        <actuator><motor name="j" joint="j"/></actuator></mujoco>"""
    )
    assert "ctrlrange" in refused(capsys, "--robot", "endless.xml")


@given(noise=st.floats(0.001, 0.1), seed=st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_noise_has_the_size_asked_for_and_rounding_adds_its_own(noise, seed):
    rng = np.random.default_rng(seed)
    states = np.zeros((20_000, 2))
    read = Readings(noise=noise, velocity_noise=2 * noise).of(states, rng)
    assert read.std(axis=0) == pytest.approx([noise, 2 * noise], rel=0.03)
    rounded = Readings(noise=noise, quantum=2 * noise).of(states, rng)
    assert rounded[:, 0].std() == pytest.approx(math.hypot(noise, 2 * noise / math.sqrt(12)), rel=0.04)


def test_impossible_sensors_are_refused():
    with pytest.raises(OptionError, match="velocity noise"):
        Readings(velocity_noise=math.nan)


def test_a_model_with_spaces_in_its_name_gives_a_valid_name(folder):
    Path("my arm@2.xml").write_text((FOLDER / "pendulum.xml").read_text().replace('model="pendulum"', 'model="my arm"'))
    words = ("--robot", "my arm@2.xml", "--episodes", "1", "--seconds", "0.2", "--excitation", "steps")
    assert main(["record", "sim", *words]) == 0
    (name,) = [path.name for path in Path("datasets").iterdir() if not path.name.startswith(".")]
    assert name.startswith("my_arm")
