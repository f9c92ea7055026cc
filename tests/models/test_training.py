"""Training recovers gaps that are known, from what is not held out, through rollouts that are the closed loop."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.dataset_samples import recorded
from support.linear_samples import LinearSimulator, knows
from support.recording_samples import GAP, paired_pendulum, pendulum, recorded_on, wander, without
from support.simulator_samples import unstable
from support.training_samples import TINY, check_gradients, same, silent, train

from nas_data.dataset import versions
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    POSITION,
    SIM_STATE,
    STATE,
    make_action_feature,
    make_state_feature,
)
from nas_data.effects.command_delay import CommandDelay
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError, UnknownName
from nas_data.models import losses
from nas_data.models.episodes import pad
from nas_data.models.evaluation import evaluate
from nas_data.models.losses import TeacherForcing
from nas_data.models.presets import TrainingOptions, preset
from nas_data.models.run import TrainingRun
from nas_data.models.split import MIN_DRAWN_FROM, split_validation
from nas_data.models.training import ModelTraining, cut_validation_rollouts, find_device
from nas_data.pairing import check_source, pair
from nas_data.simulators.mujoco import MujocoSimulator

CPU = torch.device("cpu")


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def unseen() -> Dataset:
    return paired_pendulum((150, 90, 120), seed=99)


# a known truth is recovered


@pytest.mark.parametrize(
    ("kind", "options", "share"),
    [
        ("delta", replace(TINY, updates=20), 0.1),
        ("delta", replace(TINY, epochs=10), 0.1),
        ("forward", replace(TINY, updates=60), 0.2),
        ("forward", replace(TINY, epochs=10), 0.2),
    ],
    ids=["φ free", "φ forced", "ψ free", "ψ forced"],
)
def test_a_known_gap_is_learned(tmp_path, swings, unseen, kind, options, share):
    model = train(swings, tmp_path / "run", kind, options)
    evaluation = evaluate(unseen, pendulum(), model)
    name = {"delta": "source + φ", "forward": "ψ"}[kind]
    errors = {key: value.overall for key, value in evaluation.open_loop.items()}
    assert errors["source"] > 0.05, "the gap is too small to show anything"
    assert errors[name] < share * errors["source"]
    assert errors[name] < 0.05 * errors["hold"]
    assert errors[name] < 0.1 * errors["command"]


def test_the_memory_learns_what_no_linear_map_of_the_present_can(tmp_path):
    late = (CommandDelay(delay=0.04),)
    dataset, unseen = (paired_pendulum(lengths, seed, late) for lengths, seed in (((80,) * 24, 0), ((150,) * 3, 9)))
    errors = {}
    for epochs in (0, 25):
        model = train(dataset, tmp_path / str(epochs), options=replace(TINY, epochs=epochs, rate=5e-3))
        errors[epochs] = evaluate(unseen, pendulum(), model).open_loop["source + φ"].overall
    assert errors[25] < 0.8 * errors[0]


def test_free_running_lowers_its_loss(swings):
    training = ModelTraining("forward", swings, replace(TINY, updates=60, shortcut=False), device="cpu")
    optimiser = torch.optim.Adam(training.model.parameters(), lr=5e-3)
    before = float(training.phase.loss(0).detach())
    for update in range(30):
        optimiser.zero_grad()
        training.phase.loss(update % 5).backward()
        optimiser.step()
    assert float(training.phase.loss(0).detach()) < 0.5 * before


# statistics


@pytest.mark.parametrize("count", [MIN_DRAWN_FROM + 4, 5], ids=["whole episodes", "ends of episodes"])
@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_what_is_held_out_shapes_no_statistic_and_no_first_weight(count, kind):
    dataset = paired_pendulum((40,) * count)
    options = replace(TINY, validation=0.2)
    before = ModelTraining(kind, dataset, options, device="cpu")
    if count >= MIN_DRAWN_FROM:
        held = [int(number) for number in re.findall(r"\d+", before.split.description)]
        rows = np.concatenate([np.arange(dataset.n_frames)[dataset.episode(index)] for index in held])
    else:
        assert "20%" in before.split.description
        rows = np.concatenate([np.arange(start + 32, start + 40) for start in dataset.starts])
    assert len(rows) == pytest.approx(0.2 * dataset.n_frames, rel=0.1)
    columns = {key: column.copy() for key, column in dataset.columns.items()}
    for column in columns.values():
        column[rows] = 100 * column[rows] + 7
    spoilt = replace(dataset, columns=columns)
    assert same(ModelTraining(kind, spoilt, options, device="cpu").model, before.model)
    for column in columns.values():  # and what trains does shape them
        column[0] += 1
    assert not same(ModelTraining(kind, replace(dataset, columns=columns), options, device="cpu").model, before.model)


@settings(max_examples=50, deadline=None)
@given(
    lengths=st.lists(st.integers(2, 30), min_size=1, max_size=30),
    share=st.floats(0.01, 0.99),
    seed=st.integers(0, 100),
)
def test_a_split_loses_no_frame_and_shares_none(lengths, share, seed):
    total = sum(lengths)
    features = {SIM_STATE: make_state_feature(("pendulum",))}
    numbered = np.arange(2 * total, dtype=np.float32).reshape(total, 2)
    dataset = Dataset(features, {SIM_STATE: numbered}, np.array(lengths), 50.0)
    parts = split_validation(dataset, share, seed)
    train_rows, held_rows = (set(part.sim_states[:, 0].tolist()) for part in (parts.train, parts.validation))
    assert train_rows | held_rows == set(numbered[:, 0].tolist())
    assert not train_rows & held_rows
    assert len(train_rows) + len(held_rows) == total
    assert parts.train.n_episodes and parts.validation.n_episodes
    for part in (parts.train, parts.validation):  # no episode jumps
        for rows in part.episodes():
            assert (np.diff(part.sim_states[rows, 0]) == 2).all()
    again = split_validation(dataset, share, seed)
    assert (again.description, again.validation.n_frames) == (parts.description, parts.validation.n_frames)


@pytest.mark.parametrize("count", [5, 30])
def test_held_out_episodes_keep_their_numbers(count):
    dataset = paired_pendulum((4,) * 40)
    numbers = list(range(39, 39 - count, -1))
    parts = split_validation(dataset.select(numbers), 0.2, seed=0)
    held = parts.validation
    for number, rows in zip(held.numbers, held.episodes(), strict=True):
        whole = dataset.states[dataset.episode(number)]
        assert np.array_equal(held.states[rows], whole[-(rows.stop - rows.start) :])
    listed = f"episodes {', '.join(map(str, held.numbers))}"
    assert parts.description == (listed if count == 30 else "the last 20% of each episode (fewer than 20 episodes)")


def test_long_validation_episodes_are_cut_and_few_are_kept_whole():
    long = paired_pendulum((2500, 30))
    rollouts = cut_validation_rollouts(long)
    assert rollouts.lengths.tolist() == [1000, 1000, 500, 30]
    assert np.array_equal(rollouts.states, long.states)


# free running is what a policy will live in


def linear_training(kind: str, **options) -> ModelTraining:
    """Return a training on a linear arm whose target is another linear arm, its network knowing the difference."""
    source, target = LinearSimulator.draw(0), LinearSimulator.draw(1)
    dataset = pair(recorded_on(target, wander((60, 45, 70), 2)), source)
    training = ModelTraining(kind, dataset, replace(TINY, updates=40, **options), source, device="cpu")
    knows(training.model, source, target)
    return training


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_rollouts_in_training_are_the_closed_loop_that_evaluation_runs(kind):
    training = linear_training(kind, horizon=50)
    for update in (0, 7, 39):  # short windows and long ones, wherever they start
        assert float(training.phase.loss(update).detach()) < 1e-6
    torch.nn.init.constant_(training.model.outer.bias, 0.05)
    assert float(training.phase.loss(0).detach()) > 1e-4


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_gradients_run_through_the_whole_rollout_and_the_source(kind):
    training = linear_training(kind)
    model, phase = training.model, training.phase
    with torch.no_grad():
        model.shortcut.bias += 0.2  # away from the minimum
    check_gradients(phase, ((model.shortcut.bias, (2,)), (model.shortcut.weight, (3, 0))))


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_a_discount_shares_out_what_passes_back_through_a_step_and_leaves_the_rollout_alone(kind):
    losses, gradients = [], []
    for discount in (0.0, 0.25, 1.0):
        training = linear_training(kind, horizon=2, discount=discount)  # one step to pass back through
        with torch.no_grad():
            training.model.shortcut.bias += 0.2
        loss = training.phase.loss(3)
        loss.backward()
        losses.append(float(loss.detach()))
        gradients.append(training.model.shortcut.weight.grad)
    none, quarter, whole = gradients
    assert len(set(losses)) == 1
    assert not torch.allclose(none, whole, rtol=0.01)
    torch.testing.assert_close(quarter, 0.75 * none + 0.25 * whole)


# presets


def test_the_paper_preset_is_the_published_recipe(swings, tmp_path):
    options = preset("paper")
    assert (options.epochs, options.batch, options.rate, options.layers) == (250, 1, 0.01, 3)
    assert options.hidden in (100, 128, 256)
    assert not (options.shortcut or options.relative or options.cosine or options.bf16)
    assert (options.segment, options.updates, options.clip, options.weight_decay) == (0, 0, 0.0, 0.0)
    training = ModelTraining("delta", swings, replace(options, hidden=8), pendulum(), device="cpu")
    assert isinstance(training.phase, TeacherForcing)
    assert training.phase.updates == 250 * 22
    assert {len(segment) for segment in training.phase.segments} == {60}, "whole trajectories"
    model = training.model
    assert model.shortcut is None
    assert model.lstm.num_layers == 3
    states, commands, predicted = (torch.randn(1, 2, width) for width in (2, 1, 2))
    assert torch.equal(model.raw_inputs(states, commands, predicted), torch.cat([states, commands, predicted], -1))


def test_the_paper_preset_takes_plain_adam_steps_of_constant_rate(swings, tmp_path):
    options = replace(preset("paper", hidden=8, epochs=1), layers=1)
    training = ModelTraining("delta", swings, options, device="cpu")
    twin = ModelTraining("delta", swings, options, device="cpu")
    TrainingRun(training, tmp_path / "run", silent).run()
    adam = torch.optim.Adam(twin.model.parameters(), lr=0.01)
    for update in range(22):
        adam.zero_grad()
        twin.phase.loss(update).backward()
        adam.step()
    for mine, other in zip(training.model.parameters(), twin.model.parameters(), strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-4, atol=1e-6)


def test_every_epoch_sees_every_segment_once_in_an_order_of_its_own(swings, monkeypatch):
    phase = ModelTraining("delta", swings, replace(TINY, batch=5), device="cpu").phase
    number = {id(segment): index for index, segment in enumerate(phase.segments)}
    seen: list[int] = []

    def watched_pad(segments):
        seen.extend(number[id(segment)] for segment in segments)
        return pad(segments)

    monkeypatch.setattr(losses, "pad", watched_pad)
    for update in range(2 * phase.per_validation):
        phase.loss(update)
    first, second = seen[: len(seen) // 2], seen[len(seen) // 2 :]
    assert sorted(first) == sorted(second) == list(range(len(phase.segments)))
    assert first != second


def test_the_preset_for_few_data_learns_in_short_windows():
    options = preset("few", hidden=8, updates=12)
    assert (options.preset, options.layers, options.horizon) == ("few", 1, 30)


def test_options_out_of_range_are_refused():
    with pytest.raises(UnknownName, match=r"nas2018.*fast.*paper"):
        preset("nas2018")
    for changes in (
        {"validation": 0.0},
        {"validation": 1.0},
        {"hidden": 0},
        {"horizon": 1},
        {"epochs": -1},
        {"updates": -5},
        {"seed": -1},
        {"discount": 1.1},
        {"discount": -0.1},
        {"average": 1.0},
        {"average": -0.1},
    ):
        with pytest.raises(OptionError):
            preset("fast", **changes)
    assert preset("fast", hidden=None, seed=3) == replace(TrainingOptions(), seed=3)


# what cannot be trained


def test_phi_needs_a_paired_dataset(swings):
    with pytest.raises(DatasetInvalid, match="with a model first, by `nas pair`"):
        ModelTraining("delta", without(swings), TINY)
    with pytest.raises(DatasetInvalid, match=r"nas pair datasets/arm --model MODEL\.xml"):
        versions.check_paired(Path("datasets/arm"), without(swings), "A delta model")
    assert ModelTraining("forward", without(swings), TINY, device="cpu").model.kind == "forward"


def test_a_source_of_another_arm_is_refused(swings):
    with pytest.raises(JointMismatch):
        ModelTraining("delta", swings, TINY, MujocoSimulator.load("ergojr", 0.02, threads=1))


def test_a_source_other_than_the_one_paired_with_is_refused(swings):
    check_source(swings, pendulum())
    with pytest.raises(JointMismatch, match=r"another.*nas pair"):
        check_source(swings, pendulum(*GAP))


@pytest.mark.parametrize("device", ["abacus", "cuda:63"])
def test_a_device_that_torch_cannot_use_is_refused(device):
    with pytest.raises(OptionError, match=device):
        find_device(device)
    assert find_device("cpu") == CPU


@pytest.mark.parametrize(("lengths", "updates"), [((1, 1), 0), ((1,) * 24, 5), ((1,), 5)])
def test_episodes_of_one_transition_are_refused(lengths, updates):
    dataset = paired_pendulum(lengths)
    with pytest.raises(DatasetInvalid, match="two transitions"):
        ModelTraining("forward", dataset, replace(TINY, updates=updates))


def test_a_model_that_runs_away_costs_no_training(tmp_path, swings):
    """Validation of weights that diverge counts as infinitely bad."""
    training = ModelTraining("forward", swings, replace(TINY, updates=4, shortcut=False), device="cpu")
    torch.nn.init.constant_(training.model.outer.weight, 1e20)
    training.model.get_buffer("output_std").fill_(1e20)
    assert training.validation_error() == float("inf")


def test_a_source_that_diverges_is_named(tmp_path, swings):
    (tmp_path / "model.xml").write_text(unstable().replace("hinge", "pendulum"))
    wild = MujocoSimulator.load(tmp_path / "model.xml", 0.02, ("pendulum",), threads=1)
    with pytest.raises(Exception, match=r"model\.xml diverges"):
        pair(recorded_on(pendulum(), wander((5,))), wild)


# hinges and slides


def hinge_and_slide(metre: float) -> Dataset:
    """A recording of a hinge and a slide, the slide's lengths in a unit of which so many are a metre."""
    whole = recorded(lengths=(40,) * 4, joints=("j", "g"))
    scale = {STATE: [1, metre, 1, metre], NEXT_STATE: [1, metre, 1, metre], ACTION: [1, metre]}
    features = {STATE: make_state_feature(("j", "g"), ("g",)), NEXT_STATE: make_state_feature(("j", "g"), ("g",))}
    features[ACTION] = make_action_feature(("j", "g"), (POSITION, POSITION), ("g",))
    columns = {key: (whole.columns[key] * scale[key]).astype(np.float32) for key in features}
    return Dataset(features, columns, whole.lengths, 50.0)


def test_losses_and_validation_errors_do_not_depend_on_the_unit_of_lengths():
    one, other = (ModelTraining("forward", hinge_and_slide(metre), replace(TINY, updates=2)) for metre in (1.0, 1000.0))
    assert one.criterion.endswith("over the spread of hinges, and of slides")
    assert one.validation_error() == pytest.approx(other.validation_error(), rel=1e-3)
    assert float(one.phase.loss(0).detach()) == pytest.approx(float(other.phase.loss(0).detach()), rel=1e-3)


def test_an_arm_of_one_kind_is_validated_in_its_own_unit():
    dataset = hinge_and_slide(1.0)
    hinges = replace(
        dataset,
        features={
            key: replace(f, units=tuple(u.replace("m", "rad") for u in f.units)) for key, f in dataset.features.items()
        },
    )
    training = ModelTraining("forward", hinges, replace(TINY, updates=2))
    assert training.criterion == "open-loop position RMSE [rad]"
    assert training.model.provenance["validation_unit"] == "rad"
    np.testing.assert_array_equal(training.scales, 1.0)


@pytest.mark.parametrize("ends_at_rest", [True, False])
def test_validation_data_at_rest_are_told(ends_at_rest, caplog):
    dataset = paired_pendulum((60,) * 4)
    if ends_at_rest:
        columns = {key: values.copy() for key, values in dataset.columns.items()}
        for rows in dataset.episodes():
            for key in (STATE, NEXT_STATE):
                columns[key][rows.stop - 6 : rows.stop] = dataset.states[rows.stop - 6]
        dataset = replace(dataset, columns=columns)
    ModelTraining("delta", dataset, replace(TINY, updates=0, validation=0.1), device="cpu")
    assert ("give --validation 0.3" in caplog.text) == ends_at_rest
