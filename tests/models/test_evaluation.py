"""The errors that are reported are those that a calculator gives, for every predictor, joint and episode."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from support.linear_samples import LinearSimulator, knows, network, silent
from support.recording_samples import paired_pendulum, pendulum, recorded_on, wander, without
from support.simulator_samples import motors

from nas_data import open_loop
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature, make_state_feature
from nas_data.errors import JointMismatch
from nas_data.metrics import Errors, format_error_table
from nas_data.models import predictions
from nas_data.models.evaluation import Evaluation, evaluate
from nas_data.pairing import pair
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.typed_json import make_finite

ARM = LinearSimulator(("a", "b"), a=0.5 * np.eye(4), b=np.zeros((4, 2)))  # every step halves the state


def tiny() -> Dataset:
    """Two joints, episodes of two frames and of one, numbers that can be checked by eye."""
    joints = ("a", "b")
    features = {
        STATE: make_state_feature(joints),
        ACTION: make_position_feature(joints),
        NEXT_STATE: make_state_feature(joints),
    }
    columns = {
        STATE: np.array([[0.0, 0.0, 0, 0], [1.0, 0.0, 0, 0], [4.0, 2.0, 0, 0]], np.float32),
        NEXT_STATE: np.array([[1.0, 0.0, 9, 9], [3.0, 0.0, 9, 9], [4.0, 3.0, 9, 9]], np.float32),
        ACTION: np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]], np.float32),
    }
    return Dataset(features, columns, np.array([2, 1]), 50.0)


def root_mean_square(values) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))


def test_the_trivial_baselines_by_hand():
    result = evaluate(tiny(), ARM, None)
    assert list(result.one_step) == ["source", "hold", "command"]
    assert list(result.open_loop) == ["source", "hold", "command"]
    # measured next positions: a 1, 3 | 4 and b 0, 0 | 3
    wrong = {
        "hold": ([0 - 1, 1 - 3, 4 - 4], [0, 0, 2 - 3]),
        "command": ([1 - 1, 1 - 3, 0 - 4], [1, 1, 0 - 3]),
        "source": ([0 - 1, 0.5 - 3, 2 - 4], [0, 0, 1 - 3]),
    }
    for name, (a, b) in wrong.items():
        assert result.one_step[name].per_joint == pytest.approx({"a": root_mean_square(a), "b": root_mean_square(b)})
        assert result.one_step[name].overall == pytest.approx(root_mean_square(a + b))
    # open loop: from the first state of each episode on
    wrong["hold"] = ([0 - 1, 0 - 3, 4 - 4], [0, 0, 2 - 3])
    wrong["source"] = ([0 - 1, 0 - 3, 2 - 4], [0, 0, 1 - 3])
    for name, (a, b) in wrong.items():
        found = result.open_loop[name]
        assert found.per_joint == pytest.approx({"a": root_mean_square(a), "b": root_mean_square(b)})
        assert found.overall == pytest.approx(root_mean_square(a + b))
        first, second = a[:2] + b[:2], a[2:] + b[2:]
        assert found.per_episode == pytest.approx([root_mean_square(first), root_mean_square(second)])
        assert found.mean_of_episodes == pytest.approx((root_mean_square(first) + root_mean_square(second)) / 2)


def test_without_a_source_there_is_none_and_torques_are_no_prediction(tmp_path):
    psi = silent(network("forward", ("a", "b")))
    result = evaluate(tiny(), None, psi)
    assert set(result.one_step) == set(result.open_loop) == {"ψ", "hold", "command"}
    assert result.one_step["ψ"].squared == pytest.approx(result.one_step["hold"].squared)
    assert result.open_loop["ψ"].squared == pytest.approx(result.open_loop["hold"].squared)
    (tmp_path / "motors.xml").write_text(motors())
    arm = MujocoSimulator.load(tmp_path / "motors.xml", 0.02, threads=1)
    result = evaluate(recorded_on(arm, wander((10,), size=0.05)), arm, None)
    assert set(result.one_step) == set(result.open_loop) == {"source", "hold"}


def test_phi_that_says_nothing_is_the_source_and_phi_that_knows_all_is_right():
    source, target = LinearSimulator.draw(0), LinearSimulator.draw(1)
    dataset = recorded_on(target, wander((40, 25), 2))
    nothing = evaluate(dataset, source, silent(network("delta")))
    for errors in (nothing.one_step, nothing.open_loop):
        assert errors["source"].overall > 1e-3
        np.testing.assert_allclose(errors["source + φ"].squared, errors["source"].squared, rtol=1e-4)
    for kind, name in (("delta", "source + φ"), ("forward", "ψ")):
        everything = evaluate(dataset, source, knows(network(kind), source, target))
        assert everything.one_step[name].overall < 1e-5
        assert everything.open_loop[name].overall < 1e-4
        assert set(everything.open_loop) == {name, "source", "hold", "command"}


def test_one_step_lets_the_memory_run_and_open_loop_its_own_state():
    """Checked against a plain loop, frame by frame."""
    import torch

    model = network("delta", ("pendulum",))
    dataset = paired_pendulum((12, 7))
    result = evaluate(dataset, pendulum(), model)
    for episode, rows in enumerate(dataset.episodes()):
        memory, squares = model.initial_memory(1), []
        for row in range(rows.start, rows.stop):
            inputs = (dataset.states, dataset.commands, dataset.sim_states)
            after, memory = model.next_states(*(torch.tensor(column[row])[None, None] for column in inputs), memory)
            squares.append(float(after[0, 0, 0] - dataset.next_states[row, 0]) ** 2)
        assert result.one_step["source + φ"].squared[episode, 0] == pytest.approx(np.mean(squares), rel=1e-4)


def test_episodes_of_unequal_length_do_not_disturb_each_other(monkeypatch):
    dataset = without(paired_pendulum((3, 40, 1, 25, 17)))
    model = network("delta", ("pendulum",))
    together = evaluate(dataset, pendulum(), model)
    monkeypatch.setattr(open_loop, "ROLLOUT_BATCH", 2)
    in_pairs = evaluate(dataset, pendulum(), model)
    for episode in range(dataset.n_episodes):
        alone = evaluate(dataset.select([episode]), pendulum(), model)
        for kind in ("one_step", "open_loop"):
            for name, errors in getattr(alone, kind).items():
                for other in (getattr(together, kind)[name], getattr(in_pairs, kind)[name]):
                    assert other.squared[episode] == pytest.approx(errors.squared[0], rel=1e-4, abs=1e-12)
        for name, rolled in alone.rollouts.items():
            assert len(rolled[0]) == dataset.lengths[episode]
            np.testing.assert_allclose(together.rollouts[name][episode], rolled[0], atol=1e-4)


def test_the_source_is_rolled_out_without_much_padding_and_to_the_same_bits(monkeypatch):
    dataset, simulator, rows = without(paired_pendulum((3, 40, 1, 25, 38, 17))), pendulum(), []
    roll = simulator.rollout_settled
    monkeypatch.setattr(
        simulator,
        "rollout_settled",
        lambda first, commands, loads: rows.append(commands.shape) or roll(first, commands, loads),
    )
    together = open_loop.roll_out_source(dataset, simulator)
    assert sum(size * steps for size, steps, _ in rows) == dataset.lengths.sum() + 2  # 40 and 38 are one batch
    for episode, states in enumerate(together):
        (alone,) = open_loop.roll_out_source(dataset.select([episode]), simulator)
        np.testing.assert_array_equal(states, alone)


@given(lengths=st.lists(st.integers(1, 100), min_size=1, max_size=200))
def test_each_episode_is_in_one_batch_of_its_like(lengths):
    groups = open_loop.group_by_length(np.array(lengths))
    assert sorted(episode for group in groups for episode in group) == list(range(len(lengths)))
    for group in groups:
        of_group = [lengths[episode] for episode in group]
        assert len(group) <= open_loop.ROLLOUT_BATCH
        assert min(of_group) >= open_loop.SHORTEST * max(of_group)


def test_what_the_dataset_says_of_its_source_does_not_matter():
    """The source that is given predicts, whether or not the dataset was paired, and with whatever."""
    paired = paired_pendulum((20,))
    spoilt = paired.with_column(*(key := "next.observation.sim_state",), paired.features[key], 0 * paired.sim_states)
    results = [evaluate(dataset, pendulum(), None) for dataset in (paired, without(paired), spoilt)]
    assert len({result.one_step["source"].overall for result in results}) == 1


def test_velocities_do_not_count():
    dataset = tiny()
    changed = dataset.columns[NEXT_STATE].copy()
    changed[:, 2:] += 100
    other = dataset.with_column(NEXT_STATE, dataset.features[NEXT_STATE], changed)
    one, two = evaluate(dataset, ARM, None), evaluate(other, ARM, None)
    assert one.to_json() == two.to_json()


# the numbers hang together


@st.composite
def some_errors(draw) -> Errors:
    lengths = draw(st.lists(st.integers(1, 6), min_size=1, max_size=5))
    joints = tuple(f"m{i}" for i in range(draw(st.integers(1, 3))))
    values = st.floats(-3, 3, width=32)
    predicted, measured = (
        [draw(hnp.arrays(np.float32, (length, width), elements=values)) for length in lengths]
        for width in (2 * len(joints), 2 * len(joints))
    )
    return Errors.of(joints, predicted, measured)


@settings(max_examples=60, deadline=None)
@given(some_errors())
def test_overall_joint_and_episode_agree(errors):
    content = errors.to_json()
    weights = errors.lengths / errors.lengths.sum()
    joints = np.array(list(content["per_joint"].values()))
    episodes = np.array(content["per_episode"])
    cells = np.array([list(row.values()) for row in content["per_episode_and_joint"]])
    assert content["overall"] ** 2 == pytest.approx((joints**2).mean(), rel=1e-6, abs=1e-12)
    assert content["overall"] ** 2 == pytest.approx((weights * episodes**2).sum(), rel=1e-6, abs=1e-12)
    assert content["mean_of_episodes"] == pytest.approx(episodes.mean(), rel=1e-6, abs=1e-12)
    np.testing.assert_allclose(joints**2, weights @ cells**2, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(episodes**2, (cells**2).mean(axis=1), rtol=1e-6, atol=1e-12)
    assert list(content["per_joint"]) == list(errors.joints)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 5), min_size=1, max_size=4), st.floats(0, 2))
def test_a_constant_error_is_its_size_everywhere(lengths, size):
    measured = [np.zeros((length, 4)) for length in lengths]
    errors = Errors.of(("a", "b"), [row + size for row in measured], measured)
    assert errors.overall == pytest.approx(size)
    assert errors.per_episode == pytest.approx([size] * len(lengths))
    assert errors.per_joint == pytest.approx({"a": size, "b": size})


# what is shown


def test_json_has_the_contracts_keys_is_finite_and_in_radians():
    content = evaluate(tiny(), ARM, silent(network("delta", ("a", "b")))).to_json()
    assert content["unit"] == "rad"
    for loop in ("one_step", "open_loop"):
        assert {"source", "hold", "command"} < set(content[loop])
        for errors in content[loop].values():
            assert set(errors) == {"overall", "mean_of_episodes", "per_joint", "per_episode", "per_episode_and_joint"}
            assert len(errors["per_episode"]) == len(errors["per_episode_and_joint"]) == 2
    text = json.dumps(content, allow_nan=False)
    assert json.loads(text) == content


def test_a_model_that_runs_away_is_reported_and_spoils_nothing_else():
    model = network("forward", ("a", "b"))
    model.get_buffer("output_std").fill_(1e30)
    result = evaluate(tiny(), ARM, model)
    content = json.loads(json.dumps(make_finite(result.to_json()), allow_nan=False))
    assert content["open_loop"]["ψ"]["overall"] is None or content["open_loop"]["ψ"]["overall"] > 1e20
    assert content["open_loop"]["hold"] == evaluate(tiny(), ARM, None).to_json()["open_loop"]["hold"]
    assert "ψ" in result.text()


def test_tables_are_in_degrees_and_name_every_joint_and_predictor():
    measured = [np.zeros((4, 2))]
    errors = {
        "source": Errors.of(("shoulder", "b"), [np.radians([[3.0, 4.0]] * 4)], measured),
        "source + φ": Errors.of(("shoulder", "b"), [np.radians([[1.0, 0.0]] * 4)], measured),
    }
    lines = format_error_table(errors, "Open loop").splitlines()
    assert "[deg]" in lines[0]
    assert lines[1].split()[:2] == ["shoulder", "b"]
    assert [float(word) for word in lines[2].split()[1:]] == pytest.approx(
        [3, 4, math.sqrt(12.5), math.sqrt(12.5)], abs=1e-3
    )
    assert lines[3].split()[:3] == ["source", "+", "φ"]
    assert len({len(line) for line in lines[1:]}) == 1, "columns are aligned"
    told = Evaluation(errors, errors, {}).text()
    assert "  source: the model as given" in told
    assert "hold:" not in told, "only what is in the tables"
    text = Evaluation(errors, errors, {}).episodes_text()
    assert "source + φ" in text
    assert "3.536" in text


# what does not fit


def test_another_robot_rate_or_kind_of_command_is_refused():
    dataset = paired_pendulum((5,))
    with pytest.raises(JointMismatch):
        evaluate(dataset, MujocoSimulator.load("ergojr", 0.02, threads=1), None)
    with pytest.raises(JointMismatch, match="Hz"):
        evaluate(dataset, pendulum(rate=100.0), None)
    with pytest.raises(JointMismatch, match=r"elbow.*pendulum"):
        evaluate(dataset, pendulum(), network("delta", ("elbow",)))


def test_phi_without_its_source_is_refused():
    with pytest.raises(JointMismatch, match="source"):
        evaluate(pair(tiny(), ARM), None, network("delta", ("a", "b")))


def test_progress_ends_at_the_total():
    told = []
    evaluate(paired_pendulum((150, 30)), pendulum(), network("delta", ("pendulum",)), lambda *args: told.append(args))
    assert told[0][0] <= 1
    assert all(done <= total == 150 for done, total in told)


# a model that diverges


def runaway(joints: tuple[str, ...] = ("a", "b")):
    """Return a ψ that multiplies the state of every step by eleven: after a while it leaves all bounds."""
    import torch

    model = silent(network("forward", joints))
    for name in ("input_mean", "output_mean"):
        model.get_buffer(name).zero_()
    for name in ("input_std", "output_std"):
        model.get_buffer(name).fill_(1)
    width = 2 * len(joints)
    with torch.no_grad():
        model.shortcut.weight[:, :width] = 10 * torch.eye(width)
    return model


def long_and_short() -> Dataset:
    """Two joints, an episode of 20 frames that starts away from zero, and one of 3 that starts there."""
    joints = ("a", "b")
    features = {
        STATE: make_state_feature(joints),
        ACTION: make_position_feature(joints),
        NEXT_STATE: make_state_feature(joints),
    }
    states = np.zeros((23, 4), np.float32)
    states[0] = 1
    return Dataset(features, {STATE: states, NEXT_STATE: states, ACTION: states[:, :2]}, np.array([20, 3]), 50.0)


def test_a_model_that_diverges_is_said_to_by_episode_and_time():
    result = evaluate(long_and_short(), None, runaway())
    assert list(result.diverged) == ["ψ"]
    assert result.diverged["ψ"] == {0: pytest.approx(6 / 50)}, "eleven to the sixth is the first power beyond a million"
    assert "ψ diverges in 1 of 2 episodes (episode 0 after 0.12 s)" in result.text()
    lines = [line.split() for line in result.text().splitlines()]
    assert ["ψ", "diverged"] in lines
    assert not any("nan" in word for line in lines for word in line)
    rows = result.episodes_text().splitlines()
    assert rows[2].split()[:2] == ["0", "diverged"]
    assert rows[3].split()[:2] == ["1", "0.000"]
    content = json.loads(json.dumps(make_finite(result.to_json()), allow_nan=False))
    assert content["open_loop"]["ψ"]["overall"] is None
    assert content["diverged"] == {"ψ": [{"episode": 0, "after_s": pytest.approx(0.12)}]}


def test_selected_episodes_keep_their_numbers():
    result = evaluate(long_and_short().select([1, 0]), None, runaway())
    assert result.diverged["ψ"] == {1: pytest.approx(6 / 50)}, "the place among the rollouts"
    assert "ψ diverges in 1 of 2 episodes (episode 0 after 0.12 s)" in result.text()
    rows = result.episodes_text().splitlines()
    assert [row.split()[0] for row in rows[2:]] == ["1", "0"]
    content = result.to_json()
    assert content["episodes"] == [1, 0]
    assert content["diverged"] == {"ψ": [{"episode": 0, "after_s": pytest.approx(0.12)}]}


def test_nothing_is_said_to_diverge_that_does_not():
    result = evaluate(tiny(), ARM, silent(network("delta", ("a", "b"))))
    assert result.diverged == {}
    assert "diverge" not in result.text() + result.episodes_text()


def test_torch_has_one_thread_while_models_are_evaluated(monkeypatch):
    import torch

    seen = []
    monkeypatch.setattr(predictions, "begin", lambda _: seen.append(torch.get_num_threads()))
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        evaluate(tiny(), ARM, silent(network("delta", ("a", "b"))))
        assert set(seen) == {1}
        predictions.roll_out_model(
            tiny(), None, silent(network("forward", ("a", "b"))), lambda *_: seen.append(torch.get_num_threads())
        )
        assert set(seen) == {1}
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_the_command_baseline_holds_joints_that_are_told_a_speed_or_a_torque():
    rows = np.array([[0.1, 0.2], [0.3, 0.5], [0.6, 0.9]])
    commands = rows + 1
    mixed = Dataset.from_arrays(rows, commands, rate=50, joints=("a", "b"), kind=("position", "velocity"))
    result = evaluate(mixed, None, None)
    told = root_mean_square(mixed.commands[:, 0] - mixed.next_states[:, 0])
    for errors, held in ((result.one_step, mixed.states[:, 1]), (result.open_loop, mixed.states[0, 1])):
        expected = {"a": told, "b": root_mean_square(held - mixed.next_states[:, 1])}
        assert errors["command"].per_joint == pytest.approx(expected, rel=1e-6)
    torques = Dataset.from_arrays(rows, commands, rate=50, joints=("a", "b"), kind=("torque", "torque"))
    assert "command" not in evaluate(torques, None, None).open_loop
