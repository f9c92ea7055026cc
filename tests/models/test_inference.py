"""Frozen networks: ONNX Runtime says what torch says, for every row as if it were alone, and torch stands in for it."""

import sys

import numpy as np
import pytest
import torch
from support.linear_samples import draw, network
from support.recording_samples import pendulum, wander

from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.arm_vec_env import ArmVecEnv
from nas_data.models import augmented
from nas_data.models.augmented import LearnedStepper
from nas_data.models.inference.base import prepare_inference
from nas_data.models.inference.onnx_network import OnnxNetwork
from nas_data.models.inference.torch_network import TorchNetwork

CLOSE = {"rtol": 0, "atol": 1e-6}
STEPS = 100
WAYS = {"onnx": OnnxNetwork, "torch": TorchNetwork}
OPTIONS = {
    "paper": {"relative": False, "shortcut": False},
    "relative": {"relative": True, "shortcut": False},
    "shortcut": {"relative": False, "shortcut": True},
    "both": {},
    "torques": {"commands_effort": True},
    "one layer": {"layers": 1},
    "large": {"hidden": 128},
    "stiction": {"stiction": True},
}


def episode(model, rows: int, seed: int = 0) -> list[list[np.ndarray]]:
    """Return states, commands and predictions of each step."""
    parts = [part.double().numpy() for part in draw(model, rows, STEPS, seed)]
    return [[part[:, step] for part in parts] for step in range(STEPS)]


def play(frozen, steps) -> np.ndarray:
    """Return the changes of each step, shape (T, B, 2n)."""
    return np.stack([frozen.changes(*step).copy() for step in steps])


@pytest.mark.parametrize(
    ("way", "kind", "options"),
    [
        *(("onnx", kind, options) for kind in ("delta", "forward") for options in OPTIONS if options != "stiction"),
        *(("torch", kind, "both") for kind in ("delta", "forward")),
        *((way, "delta", "stiction") for way in WAYS),
    ],
)
def test_an_episode_is_what_the_model_says_of_it_at_once(way, kind, options):
    model = network(kind, **OPTIONS[options])
    states, commands, predicted = draw(model, 5, STEPS)
    with torch.no_grad():
        expected, _ = model.changes(states, commands, predicted)
    found = play(WAYS[way](model, 5), episode(model, 5))
    rounding = 5e-6 if model.stiction else 1e-6  # with stiction, changes are differences of whole states
    np.testing.assert_allclose(found.swapaxes(0, 1), expected.numpy(), rtol=0, atol=rounding)
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize("way", WAYS)
def test_each_row_is_as_if_it_were_alone(way):
    model = network(hidden=128)
    steps = episode(model, 16)
    together = play(WAYS[way](model, 16), steps)
    for row in (0, 7, 15):
        alone = play(WAYS[way](model, 1), [[part[row : row + 1] for part in step] for step in steps])
        np.testing.assert_allclose(together[:, row], alone[:, 0], **CLOSE)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("before", [30, 31], ids=["even", "odd"])
def test_what_is_forgotten_is_forgotten_for_those_rows_only(way, before):
    model = network()
    steps = episode(model, 3)
    touched, going_on, fresh = (WAYS[way](model, 3) for _ in range(3))
    play(touched, steps[:before])
    touched.reset_memory(np.array([1]))
    after, expected = play(touched, steps[before:]), play(going_on, steps)[before:]
    np.testing.assert_allclose(after[:, [0, 2]], expected[:, [0, 2]], **CLOSE)
    np.testing.assert_allclose(after[:, 1], play(fresh, steps[before:])[:, 1], **CLOSE)
    assert np.abs(after[0, 1] - expected[0, 1]).max() > 1e-3, "the memory made no difference: the test shows nothing"


@pytest.mark.parametrize("way", WAYS)
def test_a_row_that_is_lost_does_not_touch_the_others(way):
    model = network()
    steps = episode(model, 3)
    expected = play(WAYS[way](model, 3), steps)
    for step in steps[20:]:
        step[0][1] = np.nan
    found = play(WAYS[way](model, 3), steps)
    np.testing.assert_allclose(found[:, [0, 2]], expected[:, [0, 2]], **CLOSE)


@pytest.mark.parametrize("way", WAYS)
def test_what_a_model_learns_later_does_not_reach_its_frozen_network(way):
    model = network()
    steps = episode(model, 2)
    frozen = WAYS[way](model, 2)
    expected = play(WAYS[way](model, 2), steps)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.5)
    assert np.array_equal(play(frozen, steps), expected)
    assert not np.allclose(play(WAYS[way](model, 2), steps), expected)


def without(monkeypatch, package: str) -> None:
    """Make a package one that is not installed."""
    monkeypatch.delitem(sys.modules, "nas_data.models.inference.onnx_network")
    monkeypatch.delitem(sys.modules, "nas_data.models.inference.onnx_graph")
    monkeypatch.setitem(sys.modules, package, None)


def test_the_fastest_way_present_is_used():
    assert isinstance(prepare_inference(network(), 2), OnnxNetwork)


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_torch_stands_in_where_a_package_is_absent(monkeypatch, package):
    model = network(joints=("pendulum",))
    commands = np.stack(wander((30,) * 2), axis=0)
    fast = LearnedStepper(pendulum().stepper(2), model)
    without(monkeypatch, package)
    assert isinstance(prepare_inference(model, 2), TorchNetwork)
    slow = LearnedStepper(pendulum().stepper(2), model)
    for step in range(30):
        one, other = (stepper.step(commands[:, step]) for stepper in (fast, slow))
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("stiction", [False, True])
def test_an_augmented_environment_lives_the_same_episodes_in_both_ways(monkeypatch, stiction):
    model = network("delta", TASK.joints, hidden=128, stiction=stiction)
    model.get_buffer("output_std").fill_(1e-3)
    model.get_buffer("output_mean").zero_()
    arms = []
    for way in WAYS.values():
        monkeypatch.setattr(augmented, "prepare_inference", way)
        arms.append(ArmVecEnv(TASK, LearnedStepper(TASK.simulator().stepper(4), model)))
    rng = np.random.default_rng(0)
    for arm in arms:
        arm.seed(0)
    np.testing.assert_array_equal(*(arm.reset() for arm in arms))
    for _ in range(TASK.horizon + 20):
        actions = rng.uniform(-1, 1, (4, 4)).astype(np.float32)
        (one, reward, done, _), (other, expected, over, _) = (arm.step(actions) for arm in arms)
        np.testing.assert_allclose(one, other, **CLOSE)
        np.testing.assert_allclose(reward, expected, **CLOSE)
        assert np.array_equal(done, over)
