"""Checkpoints: folders with `config.json` and `model.safetensors`, read without pickle."""

import copy
import inspect
import json
import math
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError

from nas_data.dataset.dataset import Dataset
from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models.lstm import DynamicsModel

CONFIG = "config.json"
WEIGHTS = "model.safetensors"
SHOWN = 60  # most characters of a wrong value in an error


def save(model: DynamicsModel, folder: Path, attachments: Mapping[str, bytes] | None = None) -> Path:
    """Write a checkpoint by renaming a complete folder, so that it is never partial.

    Args:
        model: Trained model.
        folder: Folder of the checkpoint; an existing one is replaced.
        attachments: Contents of further files by name, such as the source that φ corrects.
    """
    staging = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(staging, ignore_errors=True)
    copy_to_cpu(model).save_pretrained(staging)
    for name, content in (attachments or {}).items():
        (staging / name).write_bytes(content)
    shutil.rmtree(folder, ignore_errors=True)
    staging.rename(folder)
    return folder


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
    lacking = [name for name in ("kind", "joints") if name not in config]
    if lacking or not set(config) <= set(known):
        wrong = f"lacks {' and '.join(lacking)}" if lacking else f"has {', '.join(sorted(set(config) - set(known)))}"
        raise ValueError(f"{CONFIG} {wrong}")
    for name, value in config.items():
        if name in OPTION_TYPES and not OPTION_TYPES[name][1](value):
            raise ValueError(f"{name} in {CONFIG} is {json.dumps(value)[:SHOWN]}, not {OPTION_TYPES[name][0]}")
    return DynamicsModel(**config)


def is_names(value: object) -> bool:
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


def check_fits(model: DynamicsModel, dataset: Dataset, folder: Path) -> None:
    """Check that a checkpoint has the joints, control rate and command quantity of a dataset.

    Raises:
        JointMismatch: one of them differs.
    """
    if model.joints != dataset.joints:
        raise JointMismatch(
            f"The checkpoint {folder} was trained for the joints {', '.join(model.joints)}; "
            f"the dataset has {', '.join(dataset.joints)}."
        )
    if abs(model.fps / dataset.fps - 1) > 1e-3:
        raise JointMismatch(f"The checkpoint {folder} steps at {model.fps:g} Hz, the dataset at {dataset.fps:g} Hz.")
    if model.commands_effort == dataset.commands_positions:
        raise JointMismatch(f"The checkpoint {folder} and the dataset take different commands: position and torque.")
