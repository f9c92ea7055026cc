"""A training repeats itself bit for bit, goes on after interruptions, and keeps its best."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from support.recording_samples import pendulum
from support.training_samples import TINY, history, same, train

from nas_data.errors import OutputExists
from nas_data.models.checkpoint import load_for_inference
from nas_data.models.divergence import predict_bounded
from nas_data.models.losses import FreeRunning, TeacherForcing
from nas_data.models.optimiser import Optimiser
from nas_data.models.run import TrainingRun
from nas_data.models.training import ModelTraining

pytestmark = pytest.mark.usefixtures("one_thread")


# the same seed, the same bits


@pytest.mark.parametrize("options", [TINY, replace(TINY, updates=12)], ids=["forced", "free"])
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(tmp_path, swings, options):
    one, two = (train(swings, tmp_path / name, options=options) for name in ("one", "two"))
    assert same(one, two)
    assert [row["validation"] for row in history(tmp_path / "one")] == [
        row["validation"] for row in history(tmp_path / "two")
    ]
    other = train(swings, tmp_path / "other", options=replace(options, seed=1))
    assert not same(one, other)


class Interrupted(Exception):
    """Stands in for Ctrl-C."""


def interrupt_at(line: int):
    """Return a report callback that raises when it is told its n-th line."""
    told = []

    def report(text: str) -> None:
        told.append(text)
        if len(told) == line:
            raise Interrupted

    return report


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("delta", replace(TINY, epochs=4)),
        ("forward", replace(TINY, updates=12)),
        ("forward", replace(TINY, updates=12, average=0.9)),
    ],
    ids=["forced", "free", "averaged"],
)
@pytest.mark.parametrize("line", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(4, marks=pytest.mark.slow)])
def test_an_interrupted_training_ends_in_the_same_bits(tmp_path, swings, monkeypatch, kind, options, line):
    monkeypatch.setattr(FreeRunning, "per_validation", 5)
    whole = train(swings, tmp_path / "whole", kind, options)
    with pytest.raises(Interrupted):
        train(swings, tmp_path / "broken", kind, options, report=interrupt_at(line))
    assert not (tmp_path / "broken/history.json").exists(), "an unfinished training must not look finished"
    assert same(train(swings, tmp_path / "broken", kind, options), whole)
    kept = ("update", "validation", "loss")
    rows = [[str(row[key]) for key in kept] for row in history(tmp_path / "broken")]
    assert rows == [[str(row[key]) for key in kept] for row in history(tmp_path / "whole")]
    names = sorted(path.name for path in (tmp_path / "broken").iterdir())
    assert names == ["checkpoint", "history.json", "tensorboard"]


def test_a_training_interrupted_twice_within_an_update_goes_on(tmp_path, swings, monkeypatch):
    whole = train(swings, tmp_path / "whole")
    plain = TeacherForcing.loss
    for stop in (2, 5):

        def loss(self, update, stop=stop):
            if update == stop:
                raise Interrupted
            return plain(self, update)

        monkeypatch.setattr(TeacherForcing, "loss", loss)
        with pytest.raises(Interrupted):
            train(swings, tmp_path / "broken")
    monkeypatch.setattr(TeacherForcing, "loss", plain)
    assert same(train(swings, tmp_path / "broken"), whole)


def test_a_training_interrupted_before_its_first_validation_goes_on(tmp_path, swings, monkeypatch):
    def stop(_self, _model) -> float:
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(ModelTraining, "validation_error", stop)
        with pytest.raises(Interrupted):
            train(swings, tmp_path / "broken")
    assert same(train(swings, tmp_path / "broken"), train(swings, tmp_path / "whole"))


# what stands in the folder


def test_early_stopping_keeps_the_best(tmp_path, swings):
    options = replace(TINY, epochs=30, rate=0.5, cosine=False, clip=0.0)  # this learning rate throws the weights about
    model = train(swings, tmp_path / "run", options=options)
    rows = history(tmp_path / "run")
    errors = [row["validation"] for row in rows]
    assert errors[-1] > min(errors), "the training never got worse: the test shows nothing"
    training = ModelTraining("delta", swings, options, device="cpu")
    training.model.load_state_dict(model.state_dict())
    assert training.validation_error() == pytest.approx(min(errors), rel=1e-6)


def test_the_mean_of_the_weights_is_judged_and_kept(tmp_path, swings):
    options = replace(TINY, average=0.5)
    kept, last = (train(swings, tmp_path / name, options=o) for name, o in (("mean", options), ("last", TINY)))
    assert not same(kept, last)
    training = ModelTraining("delta", swings, options, device="cpu")
    descent, means, judged = Optimiser(training), [], [training.validation_error()]
    for update in range(training.phase.updates):
        descent.update(update)
        weights = [weight.detach().clone() for weight in training.model.parameters()]
        share = 1.0 if update == 0 else 1 - min(0.5, (1 + update) / (10 + update))
        means = [torch.lerp(mean, weight, share) for mean, weight in zip(means or weights, weights, strict=True)]
        if (update + 1) % training.phase.per_validation == 0:
            judged.append(training.validation_error(descent.model))
    for mean, weight in zip(means, descent.model.parameters(), strict=True):
        torch.testing.assert_close(mean, weight.detach())
    assert [row["validation"] for row in history(tmp_path / "mean")] == pytest.approx(judged)
    training.model.load_state_dict(kept.state_dict())
    assert training.validation_error() == pytest.approx(min(judged))


def test_patience_ends_a_training_that_never_gets_better(tmp_path, swings):
    options = replace(TINY, epochs=60, rate=0.5, cosine=False, clip=0.0, patience=3)
    train(swings, tmp_path / "run", options=options)
    errors = [row["validation"] for row in history(tmp_path / "run")]
    assert len(errors) < 61
    assert len(errors) - 1 - int(np.argmin(errors)) == 4, "three are borne, one more ends it"


def test_a_training_that_has_learned_goes_on_through_what_gets_no_better(tmp_path, swings):
    options = replace(TINY, epochs=30, patience=0)
    train(swings, tmp_path / "run", options=options)
    errors = [row["validation"] for row in history(tmp_path / "run")]
    best = np.minimum.accumulate(errors)
    learned = int(np.argmax(best < 0.9 * errors[0]))
    assert 0 < learned < len(errors) - 2
    assert np.any(errors[learned + 1 :] > best[learned:-1]), "there was something to be borne"
    assert len(errors) == 31


@pytest.mark.parametrize("error", [float("inf"), float("nan")])
def test_a_training_that_never_gets_a_finite_error_ends_with_its_patience(tmp_path, swings, monkeypatch, error):
    monkeypatch.setattr(ModelTraining, "validation_error", lambda *_: error)
    train(swings, tmp_path / "run", options=replace(TINY, epochs=20, patience=2))
    assert len(history(tmp_path / "run")) == 4, "the start, two that are borne, and one more"


def test_every_validation_is_told_and_kept(tmp_path, swings):
    told: list[str] = []
    train(swings, tmp_path / "run", report=told.append)
    rows = history(tmp_path / "run")
    updates = -(-22 // TINY.batch)  # batches of the 22 of 24 episodes that train
    assert [row["update"] for row in rows] == [updates * epoch for epoch in range(TINY.epochs + 1)]
    assert len(told) == len(rows)
    assert all(f"{row['validation']:.5f}" in line for row, line in zip(rows, told, strict=True))
    assert list((tmp_path / "run/tensorboard").glob("events.out.tfevents.*"))
    assert [path.name for path in tmp_path.rglob("*.pt")] == []


def test_the_returned_model_is_the_checkpoint_frozen(tmp_path, swings):
    provenance = {"dataset": {"name": "swings/v1-12345678", "content_hash": "12345678"}}
    model = train(swings, tmp_path / "run", provenance=provenance)
    assert same(model, load_for_inference(tmp_path / "run/checkpoint"))
    assert not any(parameter.requires_grad for parameter in model.parameters())
    assert (model.joints, model.fps, model.commands_effort) == (("pendulum",), 50.0, False)
    assert model.provenance["dataset"] == provenance["dataset"]
    assert model.provenance["training"] == {**TINY.__dict__}


def test_a_folder_that_is_taken_is_left_alone(tmp_path, swings):
    done = tmp_path / "done"
    train(swings, done)
    stranger = tmp_path / "stranger"
    stranger.mkdir()
    (stranger / "thesis.tex").write_text("years of work")
    file = tmp_path / "file"
    file.write_text("a file")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    for folder in (done, stranger, file):
        with pytest.raises(OutputExists, match=folder.name):
            train(swings, folder)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("change", ["options", "data", "source"])
def test_an_unfinished_training_of_something_else_is_left_alone(tmp_path, swings, change):
    def provenance(dataset: str, source: str) -> dict[str, object]:
        return {"dataset": {"content_hash": dataset}, "source": {"sha256": source}}

    with pytest.raises(Interrupted):
        train(swings, tmp_path / "run", provenance=provenance("a", "b"), report=interrupt_at(2))
    options = replace(TINY, rate=1e-3) if change == "options" else TINY
    other = provenance("x" if change == "data" else "a", "x" if change == "source" else "b")
    with pytest.raises(OutputExists, match="unfinished"):
        train(swings, tmp_path / "run", options=options, provenance=other)
    train(swings, tmp_path / "run", provenance=provenance("a", "b"))


def test_a_training_whose_first_state_could_not_be_written_starts_anew(tmp_path, swings, monkeypatch):
    def full_disk(content, path) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device", str(path))

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", full_disk)
        with pytest.raises(OSError, match="space"):
            train(swings, tmp_path / "broken")
    assert same(train(swings, tmp_path / "broken"), train(swings, tmp_path / "whole"))
    assert sorted(path.name for path in (tmp_path / "broken").iterdir()) == [
        "checkpoint",
        "history.json",
        "tensorboard",
    ]


def test_a_finished_training_says_that_it_is_and_where_its_checkpoint_lies(tmp_path, swings):
    train(swings, tmp_path / "run")
    with pytest.raises(OutputExists, match=r"this training, finished: its checkpoint is .*run/checkpoint"):
        train(swings, tmp_path / "run")
    with pytest.raises(OutputExists, match=r"finished training of other options.*run/checkpoint"):
        train(swings, tmp_path / "run", options=replace(TINY, rate=1e-3))


# what diverges


def test_a_shortcut_that_diverges_is_softened_until_its_rollouts_are_bounded(tmp_path, swings):
    options = replace(TINY, updates=12)
    training = ModelTraining("delta", swings, options, pendulum(), device="cpu")
    without_shortcut = ModelTraining("delta", swings, options, pendulum(), device="cpu")
    with torch.no_grad():
        without_shortcut.model.shortcut.weight.zero_()
        training.model.shortcut.weight.mul_(100)
    assert training.validation_error() == float("inf"), "nothing diverges: the test shows nothing"
    told: list[str] = []
    TrainingRun(training, tmp_path / "run", told.append).run()
    assert "shortcut diverges" in told[0]
    errors = [row["validation"] for row in history(tmp_path / "run")]
    assert errors[0] <= without_shortcut.validation_error()
    assert np.isfinite(errors).all()


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_windows_that_diverge_cost_no_training(swings, kind):
    training = ModelTraining(kind, swings, replace(TINY, updates=12), pendulum(), device="cpu")
    with torch.no_grad():
        training.model.shortcut.weight.mul_(1e4)
    loss = training.phase.loss(11)  # a long window
    loss.backward()
    assert torch.isfinite(loss)
    assert all(torch.isfinite(parameter.grad).all() for parameter in training.model.parameters())


def test_only_the_rows_that_a_source_refuses_are_left_out():
    states, commands = np.zeros((7, 2)), np.zeros((7, 1))
    states[:, 0] = np.linspace(0, 0.6, 7)
    expected = pendulum().predict(states, commands)
    states[[2, 6]] = np.nan, 1e200
    predicted, refused = predict_bounded(pendulum(), states, commands)
    assert refused.tolist() == [False, False, True, False, False, False, True]
    np.testing.assert_array_equal(predicted[~refused], expected[~refused])
