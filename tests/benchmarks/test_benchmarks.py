"""Benchmarks: ratios recover known truths, and the sides that are compared do the same work."""

import os

os.environ["HF_HUB_OFFLINE"] = "1"  # before anything imports huggingface_hub
os.environ["HF_DATASETS_DISABLE_PROGRESS_BARS"] = "1"

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.dataset_samples import recorded

from nas_data.benchmarks import result as benchmark_result
from nas_data.benchmarks.pairing import BareRollouts
from nas_data.benchmarks.recording import EFFECTS, GymArm, check_equal
from nas_data.benchmarks.result import SECONDS, BenchmarkResult, Ratio, Times, take_turns
from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, make_position_feature, make_state_feature
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid
from nas_data.simulators.mujoco import MujocoSimulator

RATIO = Ratio("fast_vs_slow", "fast", "slow", wanted=2.0)


class Clock:
    """A clock that only work moves."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order: list[str] = []

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 2 * self.now

    def work(self, side: str, seconds: list[float], frames: int):
        remaining = iter(seconds)

        def run() -> int:
            self.order.append(side)
            self.now += next(remaining)
            return frames

        return run


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(benchmark_result, "time", clock)
    return clock


def test_the_ratio_is_that_of_the_times_per_frame_and_the_first_run_does_not_count(clock):
    fast = clock.work("fast", [1000.0, 1.0, 1.0, 2.0], frames=10)
    slow = clock.work("slow", [0.001, 6.0, 8.0, 10.0], frames=20)
    times = take_turns({"fast": fast, "slow": slow}, rounds=3)
    assert times["fast"].wall == pytest.approx((0.1, 0.1, 0.2))
    assert times["slow"].cpu == pytest.approx((0.6, 0.8, 1.0))
    assert RATIO.values(times) == pytest.approx([3.0, 4.0, 2.5])
    assert RATIO.of(times) == pytest.approx(3.0)


def test_a_ratio_of_processor_time_goes_by_that_alone_and_says_so():
    times = {"fast": Times((1.0, 9.0), (3.0, 4.0)), "slow": Times((5.0, 6.0), (6.0, 12.0))}
    ratio = Ratio("fast_vs_slow", "fast", "slow", wanted=2.0, clock="cpu")
    assert ratio.values(times) == pytest.approx([2.0, 3.0])
    assert "in 2 rounds of processor time, required: at least 2" in ratio.describe(times)
    assert "processor" not in RATIO.describe(times)


def test_the_sides_take_turns_and_none_is_always_first(clock):
    sides = {name: clock.work(name, [1.0] * 5, frames=1) for name in ("fast", "slow")}
    take_turns(sides, rounds=4)
    pairs = list(zip(clock.order[::2], clock.order[1::2], strict=True))
    assert all(set(pair) == {"fast", "slow"} for pair in pairs)
    assert {pair[0] for pair in pairs[1:]} == {"fast", "slow"}


@given(st.lists(st.floats(1e-7, 1e-2), min_size=1, max_size=7), st.floats(0.1, 100))
def test_a_side_that_always_takes_longer_by_a_factor_gives_that_factor(wall, factor):
    slow = tuple(factor * seconds for seconds in wall)
    times = {"fast": Times(tuple(wall), tuple(wall)), "slow": Times(slow, slow)}
    assert RATIO.of(times) == pytest.approx(factor)
    answer = BenchmarkResult("title", times, (RATIO,)).to_json()
    assert answer["ratios"] == {"fast_vs_slow": pytest.approx(factor)}
    assert len(answer["rounds"]["fast_vs_slow"]) == len(wall)


def test_the_text_holds_every_round_the_spread_the_bar_and_the_hardware():
    times = {"fast": Times((1e-6, 2e-6), (3e-6, 4e-6)), "slow": Times((5e-6, 6e-6), (7e-6, 8e-6))}
    text = BenchmarkResult("what was done", times, (RATIO,), ("a note",)).to_text()
    for part in (
        "what was done",
        "fast_vs_slow 4, between 3 and 5 in 2 rounds, required: at least 2",
        "a note",
        " cores",
        "numpy",
    ):
        assert part in text
    assert text.count("fast ") == 1
    assert [line.split()[-3:] for line in text.splitlines() if line.startswith("slow")] == [["5", "6", "7"]]


def test_times_are_told_in_the_unit_of_the_result():
    result = BenchmarkResult("title", {"side": Times((1.5, 2.5), (0.5, 0.25))}, (), unit=SECONDS)
    assert result.to_json()["seconds"] == {"side": {"wall": [1.5, 2.5], "cpu": [0.5, 0.25]}}
    lines = [line.split() for line in result.to_text().splitlines()]
    assert ["seconds", "in", "round", "1", "2", "cpu"] in lines
    assert ["side", "1.5", "2.5", "0.25"] in lines


def commands(simulator: MujocoSimulator, steps: int, episodes: int = 3) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(-0.5, 0.5, (episodes, steps, len(simulator.joints))).astype(np.float32)


def test_the_bare_rollouts_are_those_that_pairing_makes(monkeypatch):
    monkeypatch.setattr("nas_data.simulators.mujoco.CHUNK_STATES", 1000)
    monkeypatch.setattr("nas_data.benchmarks.pairing.CHUNK_STATES", 1000)
    simulator = MujocoSimulator.load("ergojr", 0.01)
    n, count = len(simulator.joints), 50
    rng = np.random.default_rng(0)
    dataset = Dataset(
        features={STATE: make_state_feature(simulator.joints), ACTION: make_position_feature(simulator.joints)},
        columns={STATE: rng.normal(0, 0.1, (count, 2 * n)), ACTION: rng.normal(0, 0.1, (count, n))},
        lengths=np.array([20, 30]),
        fps=100.0,
    )
    calls = []

    class Pool:
        def __init__(self, nthread: int) -> None:
            self.nthread = nthread

        def rollout(self, model, data, states, controls, nstep):
            calls.append((self.nthread, len(data), states.copy(), controls.copy(), nstep))
            return original.rollout(model, data, states, controls, nstep=nstep)

    original = simulator._pool
    simulator._pool = Pool(simulator.threads)
    simulator.predict(dataset.states, dataset.commands)
    needed, calls = calls, []
    bare = BareRollouts.of(simulator, dataset)
    monkeypatch.setattr("mujoco.rollout.Rollout", Pool)
    assert bare.runner()() == count
    assert len(needed) == len(calls) > 1
    for ours, theirs in zip(needed, calls, strict=True):
        assert ours[1] == theirs[1]
        assert np.array_equal(ours[2], theirs[2])
        assert np.array_equal(ours[3], theirs[3])
        assert ours[4] == theirs[4]


def test_stepping_the_environment_equals_the_rollout_of_the_simulator():
    simulator = MujocoSimulator.load("ergojr", 0.01, effects=[parse(text) for text in EFFECTS])
    arm, played = GymArm(simulator), commands(simulator, steps=40)
    rest = np.zeros((len(played), 2 * len(simulator.joints)))
    expected = simulator.rollout(rest, played)
    for episode, following in zip(played, expected, strict=True):
        arm.reset()
        stepped = np.array([arm.step(command)[0] for command in episode])
        np.testing.assert_allclose(stepped, following, atol=1e-6)


def test_setting_the_environments_state_equals_pairing():
    simulator = MujocoSimulator.load("ergojr", 0.01)
    arm, played = GymArm(simulator), commands(simulator, steps=1, episodes=20)[:, 0]
    states = np.random.default_rng(1).normal(0, 0.2, (20, 12)).astype(np.float32)
    arm.reset()
    for state, command, expected in zip(states, played, simulator.predict(states, played), strict=True):
        arm.set_state(state)
        assert np.array_equal(arm.step(command)[0], expected.astype(np.float32))


def test_ways_that_record_other_numbers_are_not_compared():
    dataset = recorded()
    check_equal(dataset, dataset.with_column(STATE, dataset.features[STATE], dataset.states + np.float32(1e-6)))
    other = dataset.states.copy()
    other[3, 1] += 0.01
    with pytest.raises(DatasetInvalid, match=r"observation\.state.*0\.01"):
        check_equal(dataset, dataset.with_column(STATE, dataset.features[STATE], other))


@pytest.mark.parametrize(
    ("benchmark", "ratio"),
    [
        ("recording", "recording_vs_lerobot"),
        ("pairing", "pairing_vs_rollout"),
        ("loading", "loading_vs_dataloader"),
    ],
)
def test_each_benchmark_answers_with_its_ratio_and_leaves_nothing_behind(
    benchmark, ratio, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["benchmark", benchmark, "--episodes", "2", "--frames", "20", "--rounds", "2", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["ratios"][ratio] > 0
    assert len(answer["rounds"][ratio]) == 2
    assert answer["wanted"][ratio] > 0
    assert answer["hardware"]["cores"] >= 1
    assert "lerobot" in answer["hardware"]["versions"]
    for times in answer["microseconds_per_frame"].values():
        assert len(times["wall"]) == len(times["cpu"]) == 2
        assert min(times["wall"]) > 0
    assert list(Path(tmp_path).glob("nas-*")) == []


@pytest.mark.parametrize("option", ["episodes", "frames", "rounds"])
def test_sizes_below_one_are_refused(option, capsys):
    assert main(["benchmark", "pairing", f"--{option}", "0"]) == 2
    assert f"--{option} is 0" in capsys.readouterr().err
