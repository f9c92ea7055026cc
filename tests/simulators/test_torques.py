"""φ that corrects torques, and its symmetry: what it says of a mirror image is the mirror image of what it says."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.linear_samples import LinearSimulator, draw, network, silent
from support.recording_samples import recorded_on, wander
from support.training_samples import TINY, check_gradients, history

from nas_data.envs.base import find_task
from nas_data.errors import ModelFileError, OptionError
from nas_data.models.augmented import LearnedStepper
from nas_data.models.checkpoint import load_for_inference
from nas_data.models.evaluation import evaluate
from nas_data.models.inference.base import prepare_inference
from nas_data.models.inference.onnx_network import OnnxTorques
from nas_data.models.inference.torch_network import TorchNetwork
from nas_data.models.jacobians import estimate_command_jacobians
from nas_data.models.lstm import DynamicsModel
from nas_data.models.predictions import predict_one_step, roll_out_model
from nas_data.models.presets import preset
from nas_data.models.run import TrainingRun
from nas_data.models.symmetry import Symmetry, find_symmetry, measure_asymmetry
from nas_data.models.training import ModelTraining
from nas_data.pairing import pair
from nas_data.robots.base import Robot
from nas_data.simulators.mujoco import MujocoSimulator

JOINTS = ("m1", "m2", "m3")
torque_network = partial(network, "delta", commands_effort=True, corrects="command")
SYMMETRIC = {"cyclic": ("m1",), "mirror": {"m1": 0.0, "m3": 0.4}}


# symmetry


def test_what_pushers_model_says_of_its_symmetry_holds_and_nothing_else_does():
    source = find_task("Pusher").simulator("source")
    found = find_symmetry(source)
    assert found == {"cyclic": ("j1",), "mirror": {"j1": 0.0, "j2": 0.785, "j3": 1.57}}
    assert measure_asymmetry(source.model, source.joints, Symmetry.from_names(source.joints, **found)) < 1e-9
    for wrong in (
        {"cyclic": ("j1", "j2"), "mirror": {}},
        {"cyclic": (), "mirror": found["mirror"] | {"j3": 1.5}},
        {"cyclic": (), "mirror": {"j1": 0.0}},
    ):
        assert measure_asymmetry(source.model, source.joints, Symmetry.from_names(source.joints, **wrong)) > 0.01


def with_texts(tmp_path, text: str, new: str) -> MujocoSimulator:
    """Return Pusher's source with another text in its model."""
    content = find_task("Pusher").simulator("source").robot.mjcf.read_text()
    assert text in content
    path = tmp_path / "changed.xml"
    path.write_text(content.replace(text, new))
    return MujocoSimulator(Robot("changed", path, ("j1", "j2", "j3")), 0.05)


@pytest.mark.parametrize(
    ("text", "new", "error", "said"),
    [
        ("j3=1.57", "j3=1.5", ModelFileError, "accelerations are 5.1% off"),
        ("j3=1.57", "j3", ModelFileError, "'j1=0 j2=0.785 j3'; write joint=angle"),
        ("j3=1.57", "elbow=1.57", ModelFileError, "names the joint 'elbow'"),
        ("nas_", "our_", OptionError, "declares no symmetry: add the texts nas_cyclic and nas_mirror"),
    ],
)
def test_a_symmetry_that_does_not_hold_or_is_not_said_is_refused(tmp_path, text, new, error, said):
    with pytest.raises(error, match=said):
        find_symmetry(with_texts(tmp_path, text, new))


@settings(max_examples=25, deadline=None)
@given(turned=st.sets(st.sampled_from(JOINTS)), seed=st.integers(0, 99), layers=st.integers(1, 2))
def test_a_mirror_image_gets_the_mirror_image_of_the_answer(turned, seed, layers):
    centres = {joint: 0.3 * place for place, joint in enumerate(JOINTS) if joint in turned}
    model = bound(torque_network(JOINTS, seed, layers=layers, cyclic=("m2",), mirror=centres))
    states, commands, predicted = draw(model, 2, 7, seed)
    signs = torch.tensor([-1.0 if joint in turned else 1.0 for joint in JOINTS])
    middle = torch.tensor([centres.get(joint, 0.0) for joint in JOINTS])
    image = torch.cat([middle + signs * (states[..., :3] - middle), signs * states[..., 3:]], dim=-1)
    image[..., 1] += 1.7  # a cyclic joint turned
    here, _ = model.changes(states, commands, predicted)
    there, _ = model.changes(image, signs * commands, predicted)
    torch.testing.assert_close(there, signs * here, rtol=0, atol=1e-5)
    assert here.abs().max() > 0.05


def bound(model: DynamicsModel) -> DynamicsModel:
    """Give a network the normalisation of a symmetric one: what its mirror image turns has the mean 0."""
    assert model.symmetry is not None
    for name, signs in (("input", model.symmetry.input_signs()), ("output", model.symmetry.signs)):
        model.get_buffer(f"{name}_mean").mul_(torch.tensor(signs) > 0)
    return model


@pytest.mark.parametrize("options", [{}, SYMMETRIC], ids=["plain", "symmetric"])
def test_running_an_episode_in_one_call_equals_stepping_it(options):
    model = torque_network(JOINTS, layers=2, **options)
    states, commands, predicted = draw(model, 4, 9)
    together, _ = model.changes(states, commands, predicted)
    memory, one_by_one = model.initial_memory(4), []
    for step in range(9):
        now = slice(step, step + 1)
        change, memory = model.changes(states[:, now], commands[:, now], predicted[:, now], memory)
        one_by_one.append(change)
    assert together.shape == (4, 9, 3)
    torch.testing.assert_close(torch.cat(one_by_one, dim=1), together, rtol=0, atol=1e-5)


def test_a_correction_stays_within_its_limit():
    model = torque_network(JOINTS)
    model.get_buffer("output_mean").fill_(50.0)
    model.get_buffer("limit").copy_(torch.tensor([1.0, 2.0, 3.0]))
    changes, _ = model.changes(*draw(model, 2, 5))
    torch.testing.assert_close(changes, torch.tensor([1.0, 2.0, 3.0]).expand(2, 5, 3))


def test_what_cannot_be_is_no_model():
    with pytest.raises(ValueError, match="takes torques corrects commands"):
        network("delta", corrects="command")
    with pytest.raises(ValueError, match="takes torques corrects commands"):
        network("forward", commands_effort=True, corrects="command")
    with pytest.raises(ValueError, match="corrects commands has a symmetry"):
        network("delta", commands_effort=True, cyclic=("m1",))
    with pytest.raises(ValueError, match="choose state or command"):
        network("delta", corrects="speed")


# closed loops


class TorqueArm(LinearSimulator):
    """A linear arm that takes torques."""

    def driven(self, of_state: np.ndarray, of_command: np.ndarray) -> "TorqueArm":
        """Return this arm under further torques, linear in state and command."""
        return replace(self, a=self.a + self.b @ of_state, b=self.b @ (np.eye(len(of_command)) + of_command))


def two_arms(seed: int = 0) -> tuple[TorqueArm, TorqueArm, np.ndarray]:
    """Return a source, a target on whose joints further torques act, and those by state and command, (n, 3n)."""
    source, rng = replace(TorqueArm.draw(seed), commands_effort=True), np.random.default_rng(seed)
    of_state, of_command = 0.05 * rng.normal(size=(2, 4)), 0.1 * rng.normal(size=(2, 2))
    return source, source.driven(of_state, of_command), np.concatenate([of_state, of_command], axis=1)


def knowing(model: DynamicsModel, torques: np.ndarray) -> DynamicsModel:
    """Let a model say by its shortcut alone which torques act; its limit is too far off to matter."""
    silent(model)
    assert model.shortcut is not None
    read, put = model.inputs, model.outputs
    weight = torch.from_numpy(torques).float()
    with torch.no_grad():
        model.shortcut.weight.copy_(weight * read.std / put.std[:, None])
        model.shortcut.bias.copy_((weight @ read.mean) / put.std)
    model.get_buffer("limit").fill_(1e4)
    return model


def test_a_network_that_knows_the_torques_reproduces_the_target():
    source, target, torques = two_arms()
    model = knowing(torque_network(), torques)
    stepper, truth = LearnedStepper(source.stepper(3), model), target.stepper(3)
    rng = np.random.default_rng(1)
    initial = rng.normal(size=(3, 4))
    for one in (stepper, truth):
        one.reset(initial)
    for _ in range(50):
        commands = rng.normal(size=(3, 2))
        np.testing.assert_allclose(stepper.step(commands), truth.step(commands), rtol=0, atol=1e-4)
    assert np.abs(truth.states).max() > 0.1


def test_one_step_and_open_loop_are_the_source_under_corrected_torques():
    source, target, torques = two_arms()
    dataset = recorded_on(target, wander((40, 25), 2))
    model = knowing(torque_network(), torques)
    for predicted in (predict_one_step(dataset, model, source), roll_out_model(dataset, source, model)):
        for rows, states in zip(dataset.episodes(), predicted, strict=True):
            np.testing.assert_allclose(states, dataset.next_states[rows], rtol=0, atol=1e-4)
    found = evaluate(dataset, source, model)
    assert found.one_step["source"].overall > 10 * found.one_step["source + φ"].overall


@pytest.mark.parametrize("options", [{}, SYMMETRIC, {"cyclic": ("m2",)}], ids=["plain", "symmetric", "cyclic"])
def test_onnx_runtime_says_what_torch_says_and_forgets_the_rows_that_it_shall(options):
    model = torque_network(JOINTS, layers=2, **options)
    model = bound(model) if model.symmetry else model
    steps = [[part[:, step].double().numpy() for part in draw(model, 3, 30)] for step in range(30)]
    ways = prepare_inference(model, 3), TorchNetwork(model, 3)
    assert isinstance(ways[0], OnnxTorques)
    for number, step in enumerate(steps):
        if number == 10:
            for way in ways:
                way.reset_memory(np.array([1]))
        last, other = (way.changes(*step) for way in ways)
        np.testing.assert_allclose(last, other, rtol=0, atol=1e-5)
    fresh = prepare_inference(model, 1)
    for step in steps[10:]:
        alone = fresh.changes(*(part[1:2] for part in step))
    np.testing.assert_allclose(last[1], alone[0], rtol=0, atol=1e-5)
    assert np.abs(last).max() > 0.01


def test_one_that_says_nothing_leaves_the_source_as_it_is():
    source = find_task("Pusher").simulator("backlash")
    model = silent(torque_network(source.joints))
    plain, corrected = source.stepper(2), LearnedStepper(source.stepper(2), model)
    initial = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 6))
    for stepper in (plain, corrected):
        stepper.reset(initial)
    for commands in np.random.default_rng(1).uniform(-3, 3, (40, 2, 3)):
        assert np.array_equal(corrected.step(commands), plain.step(commands))


# training


def torque_training(**options) -> tuple[ModelTraining, np.ndarray]:
    """Return a training on arms of which one is driven by further torques."""
    source, target, torques = two_arms()
    dataset = pair(recorded_on(target, wander((60, 45, 70), 2)), source)
    options = replace(TINY, updates=40, corrects="command", **options)
    return ModelTraining("delta", dataset, options, source, device="cpu"), torques


def test_the_shortcut_begins_as_the_torques_that_are_missing():
    training, torques = torque_training()
    model = training.model
    weight = model.shortcut.weight * model.outputs.std[:, None] / model.inputs.std
    states = training.split.train.states
    # position and speed hardly move alone, so that what counts is what the weights say of the recording
    inputs = np.concatenate([states, training.split.train.commands], axis=1)
    said, true = inputs @ weight.detach().numpy().T, inputs @ torques.T
    assert np.abs(said - said.mean(0) - true + true.mean(0)).max() < 0.05 * np.abs(true).max()


def test_gradients_run_through_the_whole_rollout_and_the_source():
    training, torques = torque_training(discount=1.0)
    model, phase = knowing(training.model, torques), training.phase
    assert float(phase.loss(3).detach()) < 1e-6
    with torch.no_grad():
        model.shortcut.bias += 0.2
    check_gradients(phase, ((model.shortcut.bias, (1,)), (model.shortcut.weight, (1, 0))))


def test_slopes_by_command_are_those_of_a_linear_arm():
    source, _, _ = two_arms()
    states, commands = np.random.default_rng(0).normal(size=(2, 5, 4)), np.random.default_rng(1).normal(size=(5, 2))
    slopes = estimate_command_jacobians(source, states[0], commands, source.predict(states[0], commands))
    np.testing.assert_allclose(slopes, np.broadcast_to(source.b, slopes.shape), atol=1e-9)


def pushers_torques(episodes: int, **options) -> ModelTraining:
    """Return a training of the preset on what Pusher's target does."""
    source = find_task("Pusher").simulator("source")
    commands = [1.5 * episode for episode in wander((50,) * episodes, 3)]
    dataset = pair(recorded_on(find_task("Pusher").simulator("backlash"), commands), source)
    return ModelTraining("delta", dataset, preset("symmetric", **options), source, device="cpu")


@pytest.mark.slow
def test_the_preset_learns_pushers_torques(tmp_path):
    TrainingRun(pushers_torques(24, hidden=32, updates=120, frames=800, horizon=25), tmp_path / "a", print).run()
    rows = history(tmp_path / "a")
    assert min(row["validation"] for row in rows) < 0.8 * rows[0]["validation"]


def test_the_preset_knows_pushers_symmetry(tmp_path):
    training = pushers_torques(6, hidden=8, updates=2, frames=100, horizon=10)
    trained = TrainingRun(training, tmp_path / "a", print).run()
    loaded = load_for_inference(tmp_path / "a/checkpoint")
    assert loaded.corrects == "command"
    assert loaded.symmetry == Symmetry((True, False, False), (0.0, 0.785, 1.57), (-1, -1, -1))
    sample = draw(loaded, 2, 5)
    assert torch.equal(loaded.changes(*sample)[0], trained.changes(*sample)[0])
    assert load_for_inference(tmp_path / "a/checkpoint").get_buffer("limit").max() <= 4.0


@pytest.mark.parametrize(
    ("kind", "effort", "updates", "said"),
    [
        ("forward", True, 40, "ψ corrects nothing"),
        ("delta", False, 40, "this robot does not take torques"),
        ("delta", True, 0, "free running, which takes the source"),
    ],
)
def test_what_has_no_torques_to_correct_is_refused(kind, effort, updates, said):
    source = replace(TorqueArm.draw(0), commands_effort=effort)
    dataset = pair(recorded_on(source, wander((60, 45), 2)), source)
    options = preset("symmetric", updates=updates)
    with pytest.raises(OptionError, match=f"^The preset symmetric .*{said}.*use the preset few"):
        ModelTraining(kind, dataset, options, source, device="cpu")
    with pytest.raises(OptionError, match="A symmetry needs a φ that corrects commands"):
        preset("fast", symmetric=True)
