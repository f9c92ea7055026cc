"""Encoders that begin anew after a whole turn: found by the audit, whose remedy makes the joint go on."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import enter_with_arm, motions, write_lerobot

from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.recording import Recording
from nas_data.importing.unwrapping import unwrap

TURN = 2 * np.pi


def wrap(angles):
    return (angles + np.pi) % TURN - np.pi


def follow(goal: np.ndarray, share: float) -> np.ndarray:
    """Return the positions of a joint that covers a share of the way to its goal in each row [rad], shape (N,)."""
    path = np.full(len(goal), goal[0])
    for row in range(1, len(goal)):
        path[row] = path[row - 1] + share * (goal[row - 1] - path[row - 1])
    return path


def record(path: np.ndarray, goal: np.ndarray) -> Recording:
    """Return a recording of one joint at 50 Hz from positions and commands [rad], shape (N,)."""
    rows = np.arange(len(path))
    return Recording("log", "log", ("a",), rows * 0.02, path[:, None], None, goal[:, None], {}, rows)


@pytest.mark.parametrize("commands", [wrap, lambda angles: angles], ids=["wrapped commands", "commands that go on"])
def test_a_joint_goes_on_where_its_encoder_begins_anew(tmp_path, monkeypatch, capsys, commands):
    monkeypatch.chdir(tmp_path)
    columns = columns_of(motion())
    shift = np.array([3.0, 0.0])  # the shoulder passes half a turn
    truth = columns["q"] + shift, columns["goal"] + shift
    assert truth[0].max() > np.pi
    write_log(Path("log.npz"), columns | {"q": wrap(truth[0]), "goal": commands(truth[1])})
    write_map(tmp_path, map_text(velocity='"derive"'))
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "jumps"]) == 0
    assert "import with --unwrap" in capsys.readouterr().out
    assert main(["import", "log.npz", "--map", "map.toml", "--unwrap", "--out", "goes_on"]) == 0
    assert "The audits found no problem." in capsys.readouterr().out
    dataset = read(Path("goes_on"))
    turns = np.round((dataset.states[0, :2] - truth[0][0]) / TURN) * TURN  # where the encoder began
    np.testing.assert_allclose(dataset.states[:, :2], truth[0][:-1] + turns, atol=1e-6)
    np.testing.assert_allclose(dataset.commands, truth[1][:-1] + turns, atol=1e-6)
    assert abs(dataset.states[:, 2:]).max() < 10  # [rad/s]


def test_a_joint_that_does_not_turn_over_keeps_commands_of_more_than_half_a_turn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = columns_of(motion())
    columns["goal"] = columns["goal"] + np.where(np.arange(len(columns["q"])) % 40 < 20, 0.0, 4.0)[:, None]
    write_log(Path("log.npz"), columns)
    write_map(tmp_path)
    assert main(["import", "log.npz", "--map", "map.toml", "--unwrap", "--out", "same"]) == 0
    np.testing.assert_allclose(read(Path("same")).commands, columns["goal"][:-1], atol=1e-6)


def test_commands_that_alone_begin_anew_go_on_near_the_positions(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("logs").mkdir()
    columns = columns_of(motion())
    middles = np.array([np.pi, 4.5])  # the commands of the second log never pass half a turn
    states, commands = ([columns[key] + middle for middle in middles] for key in ("q", "goal"))
    assert not (abs(np.diff(wrap(commands[1]), axis=0)) > np.pi).any()
    for number, (path, goal) in enumerate(zip(states, commands, strict=True)):
        write_log(Path(f"logs/{number}.npz"), columns | {"q": path, "goal": wrap(goal)})
    write_map(tmp_path, map_text(velocity='"derive"'))
    assert main(["import", "logs", "--map", "map.toml", "--unwrap", "--out", "goes_on"]) == 0
    assert "The audits found no problem." in capsys.readouterr().out
    dataset = read(Path("goes_on"))
    np.testing.assert_allclose(dataset.states[:, :2], np.concatenate([path[:-1] for path in states]), atol=1e-6)
    np.testing.assert_allclose(dataset.commands, np.concatenate([goal[:-1] for goal in commands]), atol=1e-6)


def test_a_joint_that_follows_a_command_of_a_whole_turn_keeps_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = columns_of(motion())
    goal = np.where(np.arange(120) % 60 < 20, 0.0, TURN)[:, None] * [1, 1]
    path = np.zeros_like(goal)
    for row in range(1, 120):
        path[row] = path[row - 1] + 0.2 * (goal[row - 1] - path[row - 1])
    write_log(Path("log.npz"), columns | {"q": path, "goal": goal})
    write_map(tmp_path, map_text(velocity='"derive"'))
    assert main(["import", "log.npz", "--map", "map.toml", "--unwrap", "--out", "same"]) == 0
    np.testing.assert_allclose(read(Path("same")).commands, goal[:-1], atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_joint_that_has_not_arrived_at_a_command_of_a_whole_turn_keeps_it(sign):
    goal = sign * np.where(np.arange(100) < 90, 0.0, TURN)
    path = follow(goal, 0.03)
    assert 1.0 < abs(path[-1]) < 2.0
    recording = record(path, goal)
    np.testing.assert_array_equal(unwrap([recording], ["a"], ["a"], {})[0].commands, recording.commands)


@settings(max_examples=100, deadline=None)
@given(
    amplitude=st.floats(0.3, 3.0),
    period=st.integers(30, 200),
    phase=st.floats(0, TURN),
    speed=st.floats(0.2, 1.0),
    middle=st.floats(-4.0, 4.0),
)
def test_commands_that_wrap_around_go_on_near_the_positions_whatever_the_motion(
    amplitude, period, phase, speed, middle
):
    goal = middle + amplitude * np.sin(np.arange(200) * TURN / period + phase)
    path = follow(goal, speed)
    assume(abs(goal - path).max() < 1.0)
    assume((abs(np.diff(wrap(goal))) > np.pi).any())
    moved = unwrap([record(path, wrap(goal))], ["a"], ["a"], {})[0].commands[:, 0]
    np.testing.assert_allclose(moved, goal, atol=1e-9)


def test_a_lerobot_dataset_in_radians_is_unwrapped_without_a_map(tmp_path, monkeypatch):
    pytest.importorskip("lerobot")
    enter_with_arm(tmp_path, monkeypatch)
    true = [(states + 3.0, commands + 3.0) for states, commands in motions()]
    write_lerobot(Path("rec"), [(wrap(states), wrap(commands)) for states, commands in true])
    assert main(["import", "rec", "--unwrap", "--out", "goes_on"]) == 0
    dataset = read(Path("goes_on"))
    for (states, _), frames in zip(true, dataset.episodes(), strict=True):
        found = dataset.states[frames, :2]
        np.testing.assert_allclose(found - found[0], (states - states[0])[:-1], atol=1e-5)


def test_episodes_of_an_unwrapped_joint_are_not_a_turn_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = columns_of(motion())
    swing = columns["q"] - columns["q"].mean(axis=0)
    for number, (q, goal) in enumerate([(swing + np.pi, columns["goal"]), (-swing + np.pi, columns["goal"])]):
        Path("logs").mkdir(exist_ok=True)
        write_log(Path(f"logs/{number}.npz"), columns | {"q": wrap(q), "goal": wrap(goal)})
    for name, limits, expected in (("first", "", None), ("limits", "[limits]\nshoulder = [-5.0, -1.0]\n", -np.pi)):
        write_map(tmp_path, map_text(velocity='"derive"') + limits)
        assert main(["import", "logs", "--map", "map.toml", "--unwrap", "--out", name]) == 0
        dataset = read(Path(name))
        means = [dataset.states[rows, 0].mean() for rows in dataset.episodes()]
        assert abs(means[0] - means[1]) < np.pi
        if expected:
            assert means == pytest.approx([expected] * 2, abs=1.0)


def test_a_reading_that_is_no_number_is_named_and_episodes_without_a_jump_stay(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("logs").mkdir()
    columns = columns_of(motion())
    swing = columns["q"] - columns["q"].mean(axis=0)
    for number, middle in enumerate((-1.8, 2.2, 3.1)):  # only the last one passes half a turn
        write_log(Path(f"logs/{number}.npz"), columns | {"q": wrap(swing + middle), "goal": wrap(swing + middle)})
    write_map(tmp_path, map_text(velocity='"derive"'))
    assert main(["import", "logs", "--map", "map.toml", "--unwrap", "--out", "out"]) == 0
    dataset = read(Path("out"))
    means = [float(dataset.states[rows, 0].mean()) for rows in dataset.episodes()]
    assert means == pytest.approx([-1.8, 2.2, 3.1], abs=0.2)
    wrong = wrap(swing + 3.1)
    wrong[50, 0] = np.nan
    write_log(Path("logs/2.npz"), columns | {"q": wrong, "goal": wrong})
    assert main(["import", "logs", "--map", "map.toml", "--unwrap", "--out", "no"]) == 2
    error = capsys.readouterr().err
    assert "2.npz: the position is empty, NaN or infinite in row 50" in error and "0.npz" not in error


def test_the_parts_of_a_log_that_is_cut_keep_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        write_log(Path(f"logs_{name}.npz"), columns_of(motion()))
    write_map(tmp_path)
    words = ("logs_a.npz", "logs_b.npz", "--map", "map.toml", "--cut", "0.8")
    assert main(["import", *words, "--out", "out"]) == 0
    target = read_provenance(Path("out")).target
    assert [episode["log"] for episode in target["episodes"]] == ["logs_a", "logs_a", "logs_b", "logs_b"]
    part = Dataset.load("out", [1])
    assert [episode["log"] for episode in part.origin.provenance.target["episodes"]] == ["logs_a"]
