"""Checkpoints: bit-equal, frozen, without pickle, and refused in one sentence where they are none."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from support.linear_samples import draw, network
from support.recording_samples import paired_pendulum

from nas_data.dataset.dataset import Dataset
from nas_data.errors import CheckpointError, JointMismatch, OutputExists
from nas_data.models import checkpoint
from nas_data.models.lstm import DynamicsModel

KINDS = ("delta", "forward")


@pytest.mark.parametrize("kind", KINDS)
def test_a_checkpoint_is_loaded_frozen_and_equal_to_the_last_bit(tmp_path, kind):
    provenance = {"dataset": {"name": "swing/v1-12345678", "content_hash": "12345678"}, "training": {"seed": 3}}
    model = network(kind, ("shoulder", "elbow"), layers=2, relative=False, fps=49.85, provenance=provenance)
    folder = checkpoint.save(model, tmp_path / "checkpoint")
    loaded = checkpoint.load_for_inference(folder)
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
    # the hub's mixin adds a card
    assert names - {"README.md"} == {"config.json", "model.safetensors", "source.xml"}
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
    checkpoint.load_for_inference(folder)


def test_parameters_in_one_block_of_memory_are_saved_as_any_others(tmp_path):
    """As cuDNN keeps those of an LSTM on a GPU, which safetensors does not take."""
    model = network()
    parameters = list(model.lstm.parameters())
    block = torch.cat([parameter.detach().flatten() for parameter in parameters])
    for parameter, part in zip(parameters, block.split([each.numel() for each in parameters]), strict=True):
        parameter.data = part.view_as(parameter)
    loaded = checkpoint.load_for_inference(checkpoint.save(model, tmp_path / "checkpoint"))
    for name, value in model.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name
    assert parameters[0].data_ptr() == block.data_ptr(), "the model itself is unchanged"


def test_saving_again_replaces_the_checkpoint_and_leaves_nothing_behind(tmp_path):
    first, second = network(seed=0), network(seed=1)
    checkpoint.save(first, tmp_path / "checkpoint", {"source.xml": b"<mujoco/>"})
    checkpoint.save(second, tmp_path / "checkpoint")
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint"]
    assert torch.equal(checkpoint.load_for_inference(tmp_path / "checkpoint").outer.weight, second.outer.weight)
    assert not (tmp_path / "checkpoint/source.xml").exists()


def test_saving_again_keeps_the_other_files_of_the_folder(tmp_path):
    checkpoint.save(network(seed=0), tmp_path / "checkpoint")
    (tmp_path / "checkpoint/notes.txt").write_text("worked on Monday")
    checkpoint.save(network(seed=1, layers=2), tmp_path / "checkpoint")
    assert (tmp_path / "checkpoint/notes.txt").read_text() == "worked on Monday"


@pytest.mark.parametrize("name", ["training/history.json", "training/config.json", "training"])
def test_a_folder_or_file_that_is_no_checkpoint_is_not_replaced(tmp_path, name):
    other = tmp_path / name
    other.parent.mkdir(exist_ok=True)
    other.write_text('{"type": "act"}')
    with pytest.raises(OutputExists, match=r"training exists and is not a checkpoint; choose another folder"):
        checkpoint.save(network(), tmp_path / "training")
    assert other.read_text() == '{"type": "act"}'
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [other]


@pytest.mark.parametrize("options", [{}, {"relative": False}])
def test_a_save_that_is_interrupted_leaves_the_old_or_the_new_model_and_no_mixture(tmp_path, monkeypatch, options):
    """With the same options one of both can be loaded at any time; with others the folder may be refused."""
    folder, rename = tmp_path / "checkpoint", Path.replace
    first, second = network(seed=0), network(seed=1, **options)
    for survived in range(10):
        shutil.rmtree(folder, ignore_errors=True)
        checkpoint.save(first, folder)
        left = [survived]

        def rename_until_killed(path: Path, target: Path, left: list[int] = left) -> Path:
            left[0] -= 1
            if left[0] < 0:
                raise KeyboardInterrupt
            return rename(path, target)

        monkeypatch.setattr(Path, "replace", rename_until_killed)
        try:
            checkpoint.save(second, folder)
        except KeyboardInterrupt:
            if options:
                with pytest.raises(CheckpointError, match=r"holds no config\.json"):
                    checkpoint.load_for_inference(folder)
            else:
                weight = checkpoint.load_for_inference(folder).outer.weight
                assert any(torch.equal(weight, model.outer.weight) for model in (first, second))
        else:
            break
        finally:
            monkeypatch.setattr(Path, "replace", rename)
    assert survived == 3, "weights, configuration and card"


EDITED = {
    "joints that are lists": {"joints": [["m1"]]},
    "joints that are one text": {"joints": "m1"},
    "joints that are numbers": {"joints": [1, 2]},
    "a rate that is a text": {"fps": "fast"},
    "a rate of zero": {"fps": 0},
    "layers that are half": {"layers": 1.5},
    "a flag that is a text": {"commands_effort": "no"},
    "provenance that is a list": {"provenance": [["a", 1]]},
}


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
    elif how == "config is empty":
        config.write_text("{}")
    elif how == "config of another program":
        config.write_text(json.dumps({"type": "act", "n_obs_steps": 1, "chunk_size": 100}))
    elif how == "kind that does not exist":
        config.write_text(json.dumps({**json.loads(config.read_text()), "kind": "banana"}))
    elif how == "another size":
        config.write_text(json.dumps({**json.loads(config.read_text()), "hidden": 9}))
    elif how == "sizes that are no numbers":
        config.write_text(json.dumps({**json.loads(config.read_text()), "hidden": "many"}))
    elif how in EDITED:
        config.write_text(json.dumps({**json.loads(config.read_text()), **EDITED[how]}))
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
    ("how", "reason"),
    [
        ("config is empty", r"config\.json lacks kind and joints"),
        ("config of another program", r"config\.json lacks kind and joints"),
        ("another size", r"inner\.bias has shape \(8,\) in model\.safetensors, \(9,\) by config\.json"),
        ("joints that are lists", r'joints in config\.json is \[\["m1"\]\], not a list of names'),
        ("joints that are one text", r'joints in config\.json is "m1", not a list of names'),
        ("joints that are numbers", r"joints in config\.json is \[1, 2\], not a list of names"),
        ("a rate that is a text", r'fps in config\.json is "fast", not a number above 0'),
        ("a rate of zero", r"fps in config\.json is 0, not a number above 0"),
        ("layers that are half", r"layers in config\.json is 1\.5, not a whole number above 0"),
        ("a flag that is a text", r'commands_effort in config\.json is "no", not true or false'),
        ("provenance that is a list", r"provenance in config\.json is .*, not an object"),
        ("weights of another program", r"model\.safetensors has actor\.0\.weight, unlike config\.json"),
    ],
)
def test_a_checkpoint_that_was_edited_is_refused_with_what_is_wrong_in_it(tmp_path, how, reason):
    folder = checkpoint.save(network("forward"), tmp_path / "checkpoint")
    spoil(folder, how)
    with pytest.raises(CheckpointError, match=reason + r".*train it again"):
        checkpoint.load_for_inference(folder)


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
        checkpoint.load_for_inference(folder)
    assert "\n" not in str(error.value)


def test_a_checkpoint_is_found_in_the_trainings_folder(tmp_path):
    (tmp_path / "run").mkdir()
    folder = checkpoint.save(network(), tmp_path / "run" / "checkpoint")
    assert checkpoint.find_checkpoint(tmp_path / "run") == checkpoint.find_checkpoint(folder) == folder


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


def test_a_checkpoint_of_velocities_is_refused_for_torques_unless_it_is_older_than_stored_kinds(tmp_path):
    joints, rows = ("a", "b"), np.linspace(0, 0.02, 60).reshape(30, 2)

    def commanded(*kinds: str) -> Dataset:
        return Dataset.from_arrays(rows, rows, rate=50, joints=joints, kind=kinds)

    def trained(dataset: Dataset | None) -> DynamicsModel:
        provenance = {"kinds": list(dataset.kinds)} if dataset else {}
        model = network("forward", joints, commands_effort=True, provenance=provenance)
        return checkpoint.load_for_inference(checkpoint.save(model, tmp_path / "checkpoint"))

    speeds, torques = commanded("velocity", "velocity"), commanded("torque", "torque")
    both, other = commanded("position", "torque"), commanded("torque", "position")
    for mine, theirs in ((speeds, torques), (both, other), (both, torques)):
        model = trained(mine)
        checkpoint.check_fits(model, mine, tmp_path)
        with pytest.raises(JointMismatch, match=rf"commands a{mine.kinds[0]}, .*dataset has a{theirs.kinds[0]}, b\."):
            checkpoint.check_fits(model, theirs, tmp_path)
    checkpoint.check_fits(trained(None), torques, tmp_path)
    with pytest.raises(JointMismatch, match="other commands"):
        checkpoint.check_fits(trained(None), commanded("position", "position"), tmp_path)
