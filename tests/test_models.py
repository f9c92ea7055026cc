"""φ and ψ: shapes, memory, checkpoints, and closed loops that a network which knows the truth closes exactly."""

import itertools
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_samples import LinearSimulator, knows, network, silent
from recording_samples import paired_pendulum, pendulum, wander
from simulator_samples import CONTACTS

from nas_data.effects.backlash import Backlash
from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models import checkpoint
from nas_data.models.augmented import AugmentedStepper, ForwardStepper, LearnedStepper
from nas_data.models.episodes import Episode, cut, join, pad
from nas_data.models.fitting import prepare
from nas_data.models.lstm import DynamicsModel
from nas_data.models.phases import one_step_loss
from nas_data.simulators.mujoco import MujocoSimulator

KINDS = ("delta", "forward")


def draw(model: DynamicsModel, batch: int, steps: int, seed=0) -> list[torch.Tensor]:
    """Return states, commands and predictions, shape (batch, steps, …)."""
    generator = torch.Generator().manual_seed(seed)
    n = len(model.joints)
    return [torch.randn(batch, steps, width, generator=generator) for width in (2 * n, n, 2 * n)]


# the network


@settings(max_examples=30, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    n=st.integers(1, 4),
    batch=st.integers(1, 3),
    steps=st.integers(1, 6),
    layers=st.integers(1, 3),
    relative=st.booleans(),
    shortcut=st.booleans(),
    effort=st.booleans(),
)
def test_running_an_episode_in_one_call_equals_stepping_it(kind, n, batch, steps, layers, relative, shortcut, effort):
    joints = tuple(f"m{i}" for i in range(n))
    options = {"layers": layers, "relative": relative, "shortcut": shortcut, "commands_effort": effort}
    model = network(kind, joints, **options)
    states, commands, predicted = draw(model, batch, steps)
    together, last = model.next_states(states, commands, predicted)
    assert together.shape == (batch, steps, 2 * n)
    memory, one_by_one = model.no_memory(batch), []
    for step in range(steps):
        now = slice(step, step + 1)
        after, memory = model.next_states(states[:, now], commands[:, now], predicted[:, now], memory)
        one_by_one.append(after)
    torch.testing.assert_close(torch.cat(one_by_one, dim=1), together, rtol=0, atol=1e-5)
    assert [part.shape for part in memory] == [(layers, batch, 8)] * 2
    for mine, other in zip(memory, last, strict=True):
        torch.testing.assert_close(mine, other, rtol=0, atol=1e-5)


def test_the_past_matters_and_the_future_does_not():
    model = network()
    states, commands, predicted = draw(model, 1, 6)
    before, _ = model.next_states(states, commands, predicted)
    commands[0, 3] += 1
    after, _ = model.next_states(states, commands, predicted)
    assert torch.equal(after[0, :3], before[0, :3])
    assert (after[0, 3:] != before[0, 3:]).any(dim=1).all()


def test_psi_reads_no_prediction():
    model = network("forward")
    states, commands, predicted = draw(model, 2, 4)
    assert torch.equal(
        model.next_states(states, commands, predicted)[0], model.next_states(states, commands, predicted + 1)[0]
    )


def test_phi_adds_to_the_prediction_and_psi_to_the_state():
    for kind in KINDS:
        model = silent(network(kind))
        states, commands, predicted = draw(model, 2, 4)
        assert torch.equal(model.next_states(states, commands, predicted)[0], predicted if kind == "delta" else states)


def test_a_shift_of_all_angles_moves_only_the_state_inputs_of_a_relative_model():
    model = network(relative=True)
    states, commands, predicted = draw(model, 1, 3)
    shift = torch.tensor([0.3, -0.2, 0.0, 0.0])
    difference = model.raw_inputs(states + shift, commands + shift[:2], predicted + shift) - model.raw_inputs(
        states, commands, predicted
    )
    expected = torch.cat([shift, torch.zeros(6)]).expand(1, 3, 10)
    torch.testing.assert_close(difference, expected, atol=1e-6, rtol=0)


def test_torques_are_fed_as_they_are():
    model = network(relative=True, commands_effort=True)
    states, commands, predicted = draw(model, 1, 3)
    assert torch.equal(model.raw_inputs(states, commands, predicted)[..., 4:6], commands)


# batches of unequal episodes


@st.composite
def some_episodes(draw_from) -> list[Episode]:
    lengths = draw_from(st.lists(st.integers(1, 9), min_size=1, max_size=5))
    rng = np.random.default_rng(draw_from(st.integers(0, 1000)))
    widths = (4, 2, 4, 4)
    return [
        Episode(*(torch.from_numpy(rng.normal(size=(length, width)).astype(np.float32)) for width in widths))
        for length in lengths
    ]


@settings(max_examples=40, deadline=None)
@given(episodes=some_episodes(), kind=st.sampled_from(KINDS))
def test_padding_and_masking_changes_no_loss(episodes, kind):
    model = network(kind)
    cpu = torch.device("cpu")
    padded = one_step_loss(model, *pad(episodes), cpu)
    alone = [one_step_loss(model, *pad([episode]), cpu) * len(episode) for episode in episodes]
    expected = sum(alone) / sum(map(len, episodes))
    torch.testing.assert_close(padded, expected, rtol=1e-5, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(episodes=some_episodes(), longest=st.integers(0, 6))
def test_cutting_loses_no_frame(episodes, longest):
    pieces = cut(episodes, longest)
    whole, again = join(episodes), join(pieces)
    assert torch.equal(whole.states, again.states)
    assert torch.equal(whole.targets, again.targets)
    assert max(map(len, pieces)) <= (longest or 9)


def test_a_masked_loss_has_no_gradient_from_padding():
    model = network().requires_grad_(True)
    short, long = (Episode(*(torch.randn(length, width) for width in (4, 2, 4, 4))) for length in (2, 7))
    batch, mask = pad([short, long])
    states = batch.states.clone().requires_grad_(True)
    padded = Episode(states, batch.commands, batch.predicted, batch.targets)
    one_step_loss(model, padded, mask, torch.device("cpu")).backward()
    assert (states.grad[0, 2:] == 0).all()
    assert (states.grad[0, :2] != 0).any()
    assert mask.tolist() == [[True] * 2 + [False] * 5, [True] * 7]


# what is known before any gradient


@pytest.mark.parametrize("kind", KINDS)
def test_preparing_normalises_and_solves_the_linear_part(kind):
    rng = np.random.default_rng(0)
    source, target = LinearSimulator.draw(0), LinearSimulator.draw(1)
    states, commands = rng.normal(size=(4000, 4)), rng.normal(size=(4000, 2))
    columns = [states, commands, source.predict(states, commands), target.predict(states, commands)]
    transitions = Episode(*(torch.from_numpy(column.astype(np.float32)) for column in columns))
    torch.manual_seed(0)
    model = DynamicsModel(kind, ("m1", "m2"), hidden=8)
    prepare(model, transitions)
    inputs = model.inputs.normalise(model.raw_inputs(transitions.states, transitions.commands, transitions.predicted))
    torch.testing.assert_close(inputs.mean(0), torch.zeros(inputs.shape[1]), atol=1e-4, rtol=0)
    torch.testing.assert_close(inputs.std(0), torch.ones(inputs.shape[1]), atol=1e-3, rtol=0)
    solved = model.shortcut(inputs)
    base = transitions.predicted if kind == "delta" else transitions.states
    wanted = model.outputs.normalise(transitions.targets - base)
    assert (solved - wanted).square().mean() < 1e-4 * wanted.square().mean()


def test_components_that_never_move_divide_by_one():
    still = Episode(*(torch.full((50, width), 0.3) for width in (4, 2, 4, 4)))
    model = DynamicsModel("delta", ("m1", "m2"), hidden=8)
    prepare(model, still)
    after, _ = model.next_states(still.states[None], still.commands[None], still.predicted[None])
    assert torch.isfinite(after).all()


# checkpoints


@pytest.mark.parametrize("kind", KINDS)
def test_a_checkpoint_is_loaded_frozen_and_equal_to_the_last_bit(tmp_path, kind):
    provenance = {"dataset": {"name": "swing/v1-12345678", "content_hash": "12345678"}, "training": {"seed": 3}}
    model = network(kind, ("shoulder", "elbow"), layers=2, relative=False, fps=49.85, provenance=provenance)
    folder = checkpoint.save(model, tmp_path / "checkpoint")
    loaded = checkpoint.load_frozen(folder)
    assert not loaded.training
    assert not any(parameter.requires_grad for parameter in loaded.parameters())
    assert loaded.kind == kind
    assert (loaded.joints, loaded.fps, loaded.relative) == (("shoulder", "elbow"), 49.85, False)
    assert loaded.provenance == provenance
    mine, other = model.state_dict(), loaded.state_dict()
    assert list(mine) == list(other)
    assert all(torch.equal(mine[key], other[key]) for key in mine)
    sample = draw(model, 2, 5)
    assert torch.equal(model.next_states(*sample)[0], loaded.next_states(*sample)[0])


def test_a_checkpoint_holds_no_pickle_and_needs_none(tmp_path, monkeypatch):
    folder = checkpoint.save(network(), tmp_path / "checkpoint", {"source.xml": b"<mujoco/>"})
    names = {path.name for path in folder.rglob("*") if path.is_file()}
    assert (
        {"config.json", "model.safetensors", "source.xml"}
        <= names
        <= {
            "config.json",
            "model.safetensors",
            "source.xml",
            "README.md",  # the hub's mixin adds a card
        }
    )
    for path in folder.iterdir():
        head = path.read_bytes()[:2]
        assert head[:1] != b"\x80" and head != b"PK", f"{path.name} looks like a pickle"
    config = json.loads((folder / "config.json").read_text())
    assert config["kind"] == "delta"
    assert config["joints"] == ["m1", "m2"]

    def forbidden(*_args, **_kwargs):
        raise AssertionError("pickle was used")

    for name in ("pickle.load", "pickle.loads", "pickle.Unpickler", "torch.load"):
        monkeypatch.setattr(name, forbidden)
    checkpoint.load_frozen(folder)


def test_saving_again_replaces_the_checkpoint_and_leaves_nothing_behind(tmp_path):
    first, second = network(seed=0), network(seed=1)
    checkpoint.save(first, tmp_path / "checkpoint", {"source.xml": b"<mujoco/>"})
    checkpoint.save(second, tmp_path / "checkpoint")
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint"]
    assert torch.equal(checkpoint.load_frozen(tmp_path / "checkpoint").outer.weight, second.outer.weight)
    assert not (tmp_path / "checkpoint/source.xml").exists()


def spoil(folder: Path, how: str) -> None:
    config, weights = folder / "config.json", folder / "model.safetensors"
    if how == "no folder":
        shutil.rmtree(folder)
    elif how in ("no config", "no weights"):
        (config if how == "no config" else weights).unlink()
    elif how == "config is no JSON":
        config.write_text("{")
    elif how == "config is a list":
        config.write_text("[1, 2]")
    elif how == "config of another program":
        config.write_text(json.dumps({"type": "act", "n_obs_steps": 1, "chunk_size": 100}))
    elif how == "kind that does not exist":
        config.write_text(json.dumps({**json.loads(config.read_text()), "kind": "banana"}))
    elif how == "another size":
        config.write_text(json.dumps({**json.loads(config.read_text()), "hidden": 9}))
    elif how == "sizes that are no numbers":
        config.write_text(json.dumps({**json.loads(config.read_text()), "hidden": "many"}))
    elif how == "half the weights":
        weights.write_bytes(weights.read_bytes()[: weights.stat().st_size // 2])
    elif how == "pickled weights":
        torch.save(network().state_dict(), weights)
    elif how == "weights of another program":
        from safetensors.torch import save_file

        save_file({"actor.0.weight": torch.zeros(3)}, weights)
    elif how == "weights that are not finite":
        from safetensors.torch import save_file

        save_file(
            {key: torch.full_like(value, torch.nan) for key, value in network("forward").state_dict().items()}, weights
        )


@pytest.mark.parametrize(
    "how",
    [
        "no folder",
        "no config",
        "no weights",
        "config is no JSON",
        "config is a list",
        "config of another program",
        "kind that does not exist",
        "another size",
        "sizes that are no numbers",
        "half the weights",
        "pickled weights",
        "weights of another program",
        "weights that are not finite",
    ],
)
def test_what_is_no_checkpoint_is_refused_in_one_sentence(tmp_path, how):
    folder = checkpoint.save(network("forward"), tmp_path / "checkpoint")
    spoil(folder, how)
    with pytest.raises(CheckpointError, match=r"checkpoint.*train") as error:
        checkpoint.load_frozen(folder)
    assert "\n" not in str(error.value)


def test_a_checkpoint_is_found_in_the_trainings_folder(tmp_path):
    (tmp_path / "run").mkdir()
    folder = checkpoint.save(network(), tmp_path / "run" / "checkpoint")
    assert checkpoint.find(tmp_path / "run") == checkpoint.find(folder) == folder


def test_a_checkpoint_of_another_robot_rate_or_command_is_refused(tmp_path):
    dataset = paired_pendulum((5,))
    for options, words in (
        ({"joints": ("elbow",)}, "elbow.*pendulum"),
        ({"joints": ("pendulum",), "fps": 100.0}, "100 Hz.*50 Hz"),
        ({"joints": ("pendulum",), "commands_effort": True}, "command"),
    ):
        with pytest.raises(JointMismatch, match=words):
            checkpoint.check_fits(network(**options), dataset, tmp_path)
    checkpoint.check_fits(network(joints=("pendulum",)), dataset, tmp_path)


# closed loops


@pytest.mark.parametrize("what", ["plain", "backlash", "contacts"])
def test_a_network_that_says_nothing_leaves_the_source_as_it_is(tmp_path, what):
    (tmp_path / "contacts.xml").write_text(CONTACTS)
    effects = (Backlash(joint="m3", half_width=0.03),) if what == "backlash" else ()
    name = tmp_path / "contacts.xml" if what == "contacts" else "ergojr"
    simulator = MujocoSimulator.load(name, 0.02, effects=effects, threads=1)
    n = len(simulator.joints)
    model = silent(network("delta", simulator.joints))
    source, corrected = simulator.stepper(2), AugmentedStepper(simulator.stepper(2), model)
    initial = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 2 * n))
    commands = np.stack(wander((40, 40), n), axis=0)
    for stepper in (source, corrected):
        stepper.reset(initial)
    for step in range(40):
        assert np.array_equal(corrected.step(commands[:, step]), source.step(commands[:, step]))


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_a_network_that_knows_the_difference_reproduces_the_target(kind, relative):
    n, joints = 3, ("m1", "m2", "m3")
    arms = LinearSimulator.draw(0, joints), LinearSimulator.draw(1, joints)
    source, target = (arm.stepper(4) for arm in arms)
    stepper = LearnedStepper(source, knows(network(kind, joints, relative=relative), *arms))
    rng = np.random.default_rng(2)
    initial = rng.normal(size=(4, 2 * n))
    stepper.reset(initial)
    target.reset(initial)
    for _ in range(100):
        commands = rng.normal(size=(4, n))
        np.testing.assert_allclose(stepper.step(commands), target.step(commands), rtol=0, atol=1e-4)
    assert np.abs(target.states).max() > 0.1
    np.testing.assert_allclose(source.states, stepper.states, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_equals_its_members_alone(kind):
    simulator = pendulum()
    model = network(kind, ("pendulum",))
    initial = np.random.default_rng(0).normal(size=(5, 2))
    commands = np.stack(wander((30,) * 5), axis=0)
    wrap = AugmentedStepper if kind == "delta" else ForwardStepper
    together = wrap(simulator.stepper(5), model)
    together.reset(initial)
    rolled = np.stack([together.step(commands[:, step]) for step in range(30)], axis=1)
    for row in range(5):
        alone = wrap(simulator.stepper(1), model)
        alone.reset(initial[row : row + 1])
        for step in range(30):
            np.testing.assert_allclose(
                alone.step(commands[row : row + 1, step])[0], rolled[row, step], rtol=1e-6, atol=1e-6
            )


@pytest.mark.parametrize("kind", KINDS)
def test_a_reset_zeroes_the_memory_of_its_rows_only(kind):
    model = network(kind, ("pendulum",), seed=3)
    steppers = [LearnedStepper(pendulum().stepper(3), model) for _ in range(2)]
    initial = np.array([[0.1, 0.0], [0.4, 0.0], [-0.3, 0.0]])
    commands = np.stack(wander((40,) * 3), axis=0)
    for stepper in steppers:
        stepper.reset(initial)
        for step in range(20):
            stepper.step(commands[:, step])
    touched, going_on = steppers
    fresh = LearnedStepper(pendulum().stepper(1), model)
    touched.reset(initial[1:2], rows=np.array([1]))
    fresh.reset(initial[1:2])
    np.testing.assert_allclose(touched.states[1], initial[1], rtol=0, atol=1e-12)
    for step in range(20, 40):
        mixed, before = touched.step(commands[:, step]).copy(), going_on.step(commands[:, step])
        np.testing.assert_allclose(mixed[[0, 2]], before[[0, 2]], rtol=0, atol=1e-9)
        np.testing.assert_allclose(mixed[1], fresh.step(commands[1:2, step])[0], rtol=0, atol=1e-6)
    assert np.abs(mixed[1] - before[1]).max() > 1e-4, "the memory made no difference: the test shows nothing"


def test_the_source_stands_where_the_corrected_state_says():
    model = network("forward", ("pendulum",))
    source = pendulum().stepper(2)
    stepper = ForwardStepper(source, model)
    stepper.reset(np.array([[0.2, 0.0], [-0.5, 0.0]]))
    for commands in itertools.repeat(np.full((2, 1), 0.3), 10):
        states = stepper.step(commands)
    np.testing.assert_allclose(source.states, states, rtol=0, atol=1e-12)
    reference = pendulum().stepper(2)
    reference.set_states(states)
    np.testing.assert_allclose(stepper.site_positions("tip"), reference.site_positions("tip"), rtol=0, atol=1e-12)


def test_setting_states_keeps_the_memory():
    model = network("delta", ("pendulum",))
    kept, cleared = (LearnedStepper(pendulum().stepper(1), model) for _ in range(2))
    for stepper in (kept, cleared):
        stepper.reset(np.zeros((1, 2)))
        for _ in range(15):
            stepper.step(np.full((1, 1), 0.8))
    kept.set_states(np.zeros((1, 2)))
    cleared.reset(np.zeros((1, 2)))
    assert np.array_equal(kept.states, np.zeros((1, 2)))
    assert np.abs(kept.step(np.zeros((1, 1))) - cleared.step(np.zeros((1, 1)))).max() > 1e-5


def test_phi_and_psi_are_not_taken_for_each_other():
    with pytest.raises(CheckpointError, match=r"forward model.*delta"):
        AugmentedStepper(pendulum().stepper(1), network("forward", ("pendulum",)))
    with pytest.raises(CheckpointError, match=r"delta model.*forward"):
        ForwardStepper(pendulum().stepper(1), network("delta", ("pendulum",)))
    with pytest.raises(JointMismatch, match=r"elbow.*pendulum"):
        LearnedStepper(pendulum().stepper(1), network("delta", ("elbow",)))
