"""Checkpoints: folders with `config.json` and `model.safetensors`, read without pickle."""

import copy
import inspect
import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeGuard

import torch
from safetensors import SafetensorError

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import POSITION
from nas_data.dataset.layout import SOURCE, SOURCE_EFFECTS
from nas_data.errors import CheckpointError, JointMismatch, OutputExists
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator

CONFIG = "config.json"
WEIGHTS = "model.safetensors"
KINDS = "kinds"  # in the provenance: command quantity of each joint, `.pos`, `.vel` or `.effort`
REQUIRED = ("kind", "joints")  # options without a default
SOURCE_FILES = tuple(Path(name).name for name in (SOURCE, SOURCE_EFFECTS))  # stored with φ
SHOWN = 60  # most characters of a wrong value in an error


def save(model: DynamicsModel, folder: Path, attachments: Mapping[str, bytes] | None = None) -> Path:
    """Write a checkpoint: complete files are renamed into place, and other files in the folder stay.

    Args:
        model: Trained model.
        folder: Folder of the checkpoint; an existing checkpoint is replaced.
        attachments: Contents of further files by name, such as the source that φ corrects.

    Raises:
        OutputExists: the folder holds something else.
    """
    check_replaceable(folder)
    place = folder.resolve()
    staging = place.with_name(f".{place.name}.partial")
    shutil.rmtree(staging, ignore_errors=True)
    copy_to_cpu(model).save_pretrained(staging)
    for name, content in (attachments or {}).items():
        (staging / name).write_bytes(content)
    if place.exists():
        replace_files(staging, place)
    else:
        staging.rename(place)
    return folder


def check_replaceable(folder: Path) -> None:
    """Check that a folder is missing, empty or a checkpoint.

    Raises:
        OutputExists: it is none of these.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if (folder / WEIGHTS).is_file() and not (folder / CONFIG).exists():
        return  # an interrupted replacement
    try:
        config = json.loads((folder / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        config = None
    if not isinstance(config, dict) or not config.keys() >= {*REQUIRED}:  # other programs write a config.json, too
        raise OutputExists(f"{folder} exists and is not a checkpoint; choose another folder or remove it.")


def replace_files(staging: Path, folder: Path) -> None:
    """Move the files of a complete checkpoint into the folder of another one, whose files they replace.

    A training saves the same configuration again and again, so that only the weights change, in one step. Another
    configuration is removed first and written last: an interrupted replacement is refused by `load_for_inference`.
    """
    config, names = folder / CONFIG, {path.name for path in staging.iterdir()}
    if config.is_file() and config.read_bytes() != (staging / CONFIG).read_bytes():
        config.unlink()
    for name in {*SOURCE_FILES} - names:
        (folder / name).unlink(missing_ok=True)
    for name in sorted(names, key=lambda name: name == CONFIG):
        (staging / name).replace(folder / name)
    staging.rmdir()


def copy_to_cpu(model: DynamicsModel) -> DynamicsModel:
    """Return a copy whose parameters have storage of their own; on a GPU cuDNN keeps those of an LSTM in one block."""
    portable = copy.deepcopy(model).to("cpu")
    for parameter in portable.parameters():
        parameter.data = parameter.detach().clone()
    return portable


def load_for_inference(folder: Path | str) -> DynamicsModel:
    """Load a checkpoint in evaluation mode and without gradients.

    Raises:
        CheckpointError: the checkpoint is missing, incomplete or invalid.
    """
    folder = Path(folder)
    if not folder.exists():
        raise CheckpointError(f"There is no folder {folder}; give one written by `nas train`.")
    missing = [name for name in (CONFIG, WEIGHTS) if not (folder / name).is_file()]
    if missing:
        raise CheckpointError(f"{folder} holds no {' and no '.join(missing)}; give a folder written by `nas train`.")
    try:
        model = read_config(folder / CONFIG)
        weights = load_weights(folder / WEIGHTS)
        check_shapes(model, weights)
        model.load_state_dict(weights)
    except (OSError, LookupError, ValueError, TypeError, RuntimeError, SafetensorError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise CheckpointError(
            f"{folder} is not a checkpoint of `nas train` ({reason}); restore its files or train it again."
        ) from None
    return model.eval().requires_grad_(False)


def read_config(path: Path) -> DynamicsModel:
    """Build the untrained model of a configuration file.

    Raises:
        ValueError: it is no JSON object, or an option is missing, unknown or of the wrong type.
    """
    config = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(config, dict):
        raise ValueError(f"{CONFIG} is not a JSON object")
    known = inspect.signature(DynamicsModel.__init__).parameters
    lacking = [name for name in REQUIRED if name not in config]
    if lacking or not set(config) <= set(known):
        wrong = f"lacks {' and '.join(lacking)}" if lacking else f"has {', '.join(sorted(set(config) - set(known)))}"
        raise ValueError(f"{CONFIG} {wrong}")
    for name, value in config.items():
        if name in OPTION_TYPES and not OPTION_TYPES[name][1](value):
            raise ValueError(f"{name} in {CONFIG} is {json.dumps(value)[:SHOWN]}, not {OPTION_TYPES[name][0]}")
    return DynamicsModel(**config)


def is_names(value: object) -> TypeGuard[list[str]]:
    """Whether a value is a list of strings."""
    return isinstance(value, list) and all(isinstance(name, str) for name in value)


def is_count(value: object) -> bool:
    """Whether a value is a whole number above 0."""
    return type(value) is int and value > 0


def is_rate(value: object) -> bool:
    """Whether a value is a finite number above 0."""
    return type(value) in (int, float) and 0 < float(str(value)) < math.inf


def is_flag(value: object) -> bool:
    """Whether a value is true or false."""
    return isinstance(value, bool)


def is_angles(value: object) -> bool:
    """Whether a value is None or an object of numbers."""
    return value is None or (isinstance(value, dict) and all(type(angle) in (int, float) for angle in value.values()))


def is_object(value: object) -> bool:
    """Whether a value is None or an object."""
    return value is None or isinstance(value, dict)


# Type of each option, as named in errors, and its check; the model itself checks `kind` and `corrects`.
OPTION_TYPES: Mapping[str, tuple[str, Callable[[object], bool]]] = {
    "joints": ("a list of names", is_names),
    "cyclic": ("a list of names", is_names),
    "hidden": ("a whole number above 0", is_count),
    "layers": ("a whole number above 0", is_count),
    "relative": ("true or false", is_flag),
    "shortcut": ("true or false", is_flag),
    "stiction": ("true or false", is_flag),
    "commands_effort": ("true or false", is_flag),
    "fps": ("a number above 0", is_rate),
    "mirror": ("an object of angles", is_angles),
    "provenance": ("an object", is_object),
}


def check_shapes(model: DynamicsModel, weights: Mapping[str, torch.Tensor]) -> None:
    """Check that weights have the names and shapes of a model.

    Raises:
        ValueError: names the first weight that differs.
    """
    wanted = model.state_dict()
    for name in sorted(set(wanted) | set(weights)):
        if name not in weights or name not in wanted:
            raise ValueError(f"{WEIGHTS} {'lacks' if name in wanted else 'has'} {name}, unlike {CONFIG}")
        here, there = (tuple(values[name].shape) for values in (weights, wanted))
        if here != there:
            raise ValueError(f"{name} has shape {here} in {WEIGHTS}, {there} by {CONFIG}")


def load_weights(path: Path) -> dict[str, torch.Tensor]:
    """Read a safetensors file.

    Raises:
        ValueError: a weight is not finite.
    """
    from safetensors.torch import load_file

    weights = load_file(path)
    invalid = [name for name, values in weights.items() if not torch.isfinite(values).all()]
    if invalid:
        raise ValueError(f"{invalid[0]} is not finite")
    return weights


def find_checkpoint(folder: Path) -> Path:
    """Return the folder of a checkpoint, given it or the folder of its training."""
    inside = folder / "checkpoint"
    return inside if (inside / CONFIG).is_file() else folder


def check_fits(model: DynamicsModel, other: Dataset | Simulator, folder: Path) -> None:
    """Check that a checkpoint has the joints, control rate and command quantities of a dataset or an environment.

    Args:
        model: The checkpoint's model. Without stored kinds, it is only known whether all joints take positions.
        other: The dataset, or the environment's simulator.
        folder: The checkpoint's folder, for errors.

    Raises:
        JointMismatch: one of them differs.
    """
    name, rate = ("dataset", other.fps) if isinstance(other, Dataset) else ("environment", 1 / other.period)
    trained = f"The checkpoint {folder} was trained"
    if model.joints != other.joints:
        raise JointMismatch(
            f"{trained} for the joints {', '.join(model.joints)}; the {name} has {', '.join(other.joints)}."
        )
    if abs(model.fps / rate - 1) > 1e-3:
        raise JointMismatch(
            f"{trained} at {model.fps:g} Hz; the {name} runs at {rate:g} Hz. Record and train at that rate."
        )
    known, kinds = model.provenance.get(KINDS), list(other.kinds)
    if known is None and model.commands_effort == (set(kinds) == {POSITION}):
        raise JointMismatch(f"{trained} for other commands than those of the {name}: position and torque or velocity.")
    if known not in (None, kinds):
        theirs, ours = (name_commands(model.joints, each) for each in (known, kinds))
        raise JointMismatch(f"{trained} for the commands {theirs}; the {name} has {ours}.")


def name_commands(joints: Sequence[str], kinds: object) -> str:
    """Return the names of commands, such as m1.pos, m2.effort; a list of kinds from a file may be damaged."""
    if not is_names(kinds):
        return str(kinds)[:SHOWN]
    return ", ".join(joint + kind for joint, kind in zip(joints, kinds, strict=False))
