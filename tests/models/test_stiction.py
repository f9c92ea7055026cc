"""Stiction in φ: joints stand still below their thresholds, and are corrected as before far above them."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.linear_samples import LinearSimulator, draw, network, silent
from support.recording_samples import recorded_on, wander
from support.training_samples import TINY, history, train

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature, make_state_feature
from nas_data.errors import CheckpointError, OptionError
from nas_data.models import checkpoint
from nas_data.models.augmented import LearnedStepper
from nas_data.models.evaluation import evaluate
from nas_data.models.inference.onnx_network import OnnxNetwork
from nas_data.models.inference.torch_network import TorchNetwork
from nas_data.models.lstm import DynamicsModel
from nas_data.models.presets import choose_preset, preset
from nas_data.models.run import TrainingRun
from nas_data.models.stiction import CLOSED, compute_share, hold_below_threshold, hold_in_place
from nas_data.models.training import ModelTraining
from nas_data.pairing import pair

FAR = 1e3  # output for a threshold far above every displacement
WAYS = {"onnx": OnnxNetwork, "torch": TorchNetwork}


def with_thresholds(output: float, seed: int = 0, **options) -> DynamicsModel:
    """Return a random φ whose outputs for the thresholds are constant."""
    model = network(stiction=True, seed=seed, **options)
    n = len(model.joints)
    for part in (model.outer, model.shortcut):
        part.weight[-n:] = 0
        part.bias[-n:] = 0
    model.outer.bias[-n:] = output
    return model


@pytest.mark.parametrize("way", WAYS)
def test_joints_below_their_thresholds_stand_still_in_closed_loop(way, monkeypatch):
    monkeypatch.setattr("nas_data.models.augmented.prepare_inference", WAYS[way])
    source = LinearSimulator.draw(0)
    stepper = LearnedStepper(source.stepper(3), with_thresholds(FAR))
    start = np.random.default_rng(1).normal(size=(3, 4))
    stepper.reset(start)
    for _ in range(250):
        states = stepper.step(np.ones((3, 2)))
    np.testing.assert_allclose(states[:, :2], start[:, :2], atol=2e-5)
    np.testing.assert_allclose(states[:, 2:], 0, atol=1e-6)


def test_without_thresholds_phi_corrects_as_one_without_stiction():
    model = with_thresholds(-FAR)
    plain = network()
    weights = model.state_dict()
    weights.pop("threshold_scale")
    plain.load_state_dict({name: value[: len(plain.state_dict()[name])] for name, value in weights.items()})
    inputs = draw(plain, 2, 5)
    torch.testing.assert_close(model.changes(*inputs)[0], plain.changes(*inputs)[0], rtol=0, atol=1e-5)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.lists(st.floats(0, 1), min_size=3, max_size=3),
)
def test_a_displacement_is_reduced_by_the_threshold_and_never_reversed(displacement, threshold):
    moves, thresholds = np.array(displacement), np.array(threshold)
    moved = compute_share(moves, thresholds) * moves
    np.testing.assert_allclose(np.abs(moved), np.maximum(np.abs(moves) - thresholds, 0), atol=1e-6)
    assert (moved * moves >= 0).all()


def test_training_and_inference_compute_the_same():
    rng = np.random.default_rng(0)
    outputs, states, predicted = rng.normal(size=(5, 9)), *rng.normal(size=(2, 5, 6))
    scale = np.array([0.1, 1.0, 10.0])
    tensors = (torch.from_numpy(part) for part in (outputs[:, :6], outputs[:, 6:], scale, states, predicted))
    expected = hold_below_threshold(*tensors).numpy()
    np.testing.assert_allclose(hold_in_place(outputs, scale, states, predicted), expected, atol=1e-12)


def test_a_joint_at_its_threshold_has_a_finite_gradient():
    outputs = torch.zeros(1, 2, requires_grad=True)
    states = torch.zeros(1, 4, requires_grad=True)
    hold_below_threshold(torch.zeros(1, 4), outputs, torch.ones(2), states, torch.zeros(1, 4)).sum().backward()
    assert torch.isfinite(outputs.grad).all()
    assert torch.isfinite(states.grad).all()


def test_gradients_just_above_a_threshold_are_bounded():
    changes = torch.zeros(1, 4)
    changes[0, :2], changes[0, 2:] = 1.001e-4, 5.0
    changes.requires_grad_()
    outputs = torch.full((1, 2), np.log(np.expm1(1.0)) - CLOSED, requires_grad=True)  # thresholds of one unit
    states, predicted = torch.zeros(2, 1, 4)
    hold_below_threshold(changes, outputs, torch.full((2,), 1e-4), states, predicted).sum().backward()
    assert float(changes.grad.abs().max()) < 2
    assert float(outputs.grad.abs().max()) < 2


def test_a_checkpoint_keeps_stiction(tmp_path):
    model = with_thresholds(0.5)
    read = checkpoint.load_for_inference(checkpoint.save(model, tmp_path / "phi"))
    assert read.stiction
    inputs = draw(model, 2, 5)
    assert torch.equal(read.changes(*inputs)[0], model.changes(*inputs)[0])


def test_a_checkpoint_without_the_option_is_one_without_stiction(tmp_path):
    model = network()
    folder = checkpoint.save(model, tmp_path / "phi")
    config = json.loads((folder / "config.json").read_text())
    config.pop("stiction")
    (folder / "config.json").write_text(json.dumps(config))
    read = checkpoint.load_for_inference(folder)
    assert not read.stiction
    inputs = draw(model, 2, 5)
    assert torch.equal(read.changes(*inputs)[0], model.changes(*inputs)[0])


def test_a_checkpoint_whose_stiction_is_no_flag_is_refused(tmp_path):
    folder = checkpoint.save(network(), tmp_path / "phi")
    config = json.loads((folder / "config.json").read_text()) | {"stiction": "yes"}
    (folder / "config.json").write_text(json.dumps(config))
    with pytest.raises(CheckpointError, match="stiction"):
        checkpoint.load_for_inference(folder)


def test_stiction_is_of_phi_that_corrects_states():
    with pytest.raises(ValueError, match="stiction"):
        DynamicsModel("forward", ["m1"], stiction=True)
    with pytest.raises(OptionError, match="Stiction"):
        preset("symmetric", stiction=True)
    assert not preset("paper").stiction
    assert not TINY.stiction


def test_a_silent_phi_with_stiction_moves_a_little_less_than_the_source():
    model = silent(network(stiction=True))
    states, commands, predicted = draw(model, 2, 4)
    after = model.next_states(states, commands, predicted)[0]
    moved, wanted = (after - states)[..., :2].abs(), (predicted - states)[..., :2].abs()
    assert (moved < wanted).all()
    torch.testing.assert_close(moved, (wanted - 0.0486).clamp_min(0), rtol=0, atol=1e-3)


def test_phi_of_an_arm_that_takes_positions_has_stiction_by_default(swings):
    options = replace(TINY, stiction=True)
    assert ModelTraining("delta", swings, options, device="cpu").model.stiction
    assert choose_preset("delta", commands_positions=True) == "stiction"
    assert preset("stiction").stiction
    assert (
        choose_preset("delta", commands_positions=False) == choose_preset("forward", commands_positions=True) == "fast"
    )


def test_stiction_is_refused_where_it_cannot_act(swings):
    source = replace(LinearSimulator.draw(0), commands_effort=True)
    dataset = pair(recorded_on(source, wander((60, 45), 2)), source)
    for kind, data, words in (("delta", dataset, "an arm with other commands"), ("forward", swings, "ψ")):
        with pytest.raises(OptionError, match=f"not for {words}; use the preset fast"):
            ModelTraining(kind, data, replace(TINY, stiction=True), device="cpu")


def test_training_starts_from_low_thresholds_and_the_linear_shortcut(swings):
    plain, sticky = (
        ModelTraining("delta", swings, replace(TINY, stiction=flag), device="cpu") for flag in (False, True)
    )
    outputs = len(plain.model.shortcut.bias)
    torch.testing.assert_close(sticky.model.shortcut.weight[:outputs], plain.model.shortcut.weight)
    assert not sticky.model.shortcut.weight[outputs:].any()
    assert not sticky.model.shortcut.bias[outputs:].any()
    moves = np.diff(swings.states[:60, 0])
    assert 0.3 < float(sticky.model.get_buffer("threshold_scale")) / moves.std() < 3


@pytest.mark.parametrize("updates", [0, 40])
def test_both_trainings_reduce_the_error_of_phi_with_stiction(swings, tmp_path, updates):
    train(swings, tmp_path / "phi", options=replace(TINY, stiction=True, updates=updates))
    rows = history(tmp_path / "phi")
    assert rows[-1]["validation"] < rows[0]["validation"]


DRY = 0.1  # [rad] error of the servo below which the joint of the test does not move


def record_sticking_joint(commands: np.ndarray) -> Dataset:
    """Return episodes of a joint that goes 30 % of the way by which its command exceeds `DRY`; commands are (B, T)."""
    states = [np.zeros((len(commands), 2))]
    for command in commands.T:
        pull = command - states[-1][:, 0]
        move = 0.3 * np.sign(pull) * np.maximum(np.abs(pull) - DRY, 0)
        states.append(np.stack([states[-1][:, 0] + move, move / 0.02], axis=1))
    before, after = (np.stack(part, axis=1).reshape(-1, 2).astype(np.float32) for part in (states[:-1], states[1:]))
    features = {
        STATE: make_state_feature(("m1",)),
        ACTION: make_position_feature(("m1",)),
        NEXT_STATE: make_state_feature(("m1",)),
    }
    columns = {STATE: before, ACTION: commands.reshape(-1, 1).astype(np.float32), NEXT_STATE: after}
    return Dataset(features, columns, np.full(len(commands), commands.shape[1]), 50.0)


@pytest.mark.slow
def test_phi_with_stiction_learns_where_a_sticking_joint_stops(tmp_path):
    rng = np.random.default_rng(0)
    source = LinearSimulator(("m1",), a=np.array([[0.2, 0], [-40, 0]]), b=np.array([[0.8], [40]]))  # does not stick
    taught = pair(record_sticking_joint(np.repeat(rng.uniform(-1, 1, (24, 10)), 20, axis=1)), source)
    unseen = record_sticking_joint(np.repeat(rng.uniform(-1, 1, (6, 2)), 300, axis=1))
    errors, drifts = {}, {}
    for stiction in (False, True):
        options = replace(TINY, stiction=stiction, updates=120, frames=800, horizon=60, discount=0.97)
        training = ModelTraining("delta", taught, options, source, device="cpu")
        found = evaluate(unseen, source, TrainingRun(training, tmp_path / str(stiction), print).run())
        errors[stiction] = found.open_loop["source + φ"].overall
        drifts[stiction] = found.holding.average("source + φ")
    assert errors[True] < 0.5 * errors[False]
    assert drifts[True] < 0.5 * drifts[False]
