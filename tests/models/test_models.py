"""φ and ψ as networks: shapes, memory, padding, and what is known before any gradient."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.linear_samples import LinearSimulator, draw, network, silent

from nas_data.models.episodes import Episode, cut_episodes, join, pad
from nas_data.models.fitting import prepare
from nas_data.models.losses import compute_one_step_loss
from nas_data.models.lstm import DynamicsModel

KINDS = ("delta", "forward")


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
    memory, one_by_one = model.initial_memory(batch), []
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
    padded = compute_one_step_loss(model, *pad(episodes), cpu)
    alone = [compute_one_step_loss(model, *pad([episode]), cpu) * len(episode) for episode in episodes]
    expected = sum(alone) / sum(map(len, episodes))
    torch.testing.assert_close(padded, expected, rtol=1e-5, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(episodes=some_episodes(), longest=st.integers(0, 6))
def test_cutting_loses_no_frame(episodes, longest):
    pieces = cut_episodes(episodes, longest)
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
    compute_one_step_loss(model, padded, mask, torch.device("cpu")).backward()
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
