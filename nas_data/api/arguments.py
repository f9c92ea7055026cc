"""Common arguments of the API: a dataset or its folder, a model with its actuators, progress."""

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import find_root, load, with_origin
from nas_data.errors import OptionError
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.report import GapReport
from nas_data.gap.write_model import EFFECTS
from nas_data.robots.base import TORQUES, URDF

Progress = Callable[[str], None]
Count = Callable[[int, int], None]
Actuators = Literal["position", "torque"]


def count_aloud(progress: Progress) -> Count:
    """Return a count function that reports the control steps done as sentences."""
    return lambda done, total: progress(f"rolling out {done}/{total}")


def as_dataset(dataset: Dataset | str | Path, episodes: Iterable[int] | None = None) -> Dataset:
    """Return a dataset as transitions; a folder is read.

    Args:
        dataset: In memory, or its folder.
        episodes: Only these episodes, each once; None for all.

    Raises:
        NasError: it cannot be used.
    """
    if not isinstance(dataset, Dataset):
        return load(Path(dataset), episodes)
    return with_origin(dataset).select_each_once(episodes)


def find_name(dataset: Dataset) -> Path:
    """Return the name of a dataset for reports and errors: its folder, if it has one."""
    folder = dataset.origin.root if dataset.origin else None
    return folder or Path("dataset")


def find_folder(dataset: Dataset) -> Path | None:
    """Return the folder of a dataset; None if it only exists in memory, was changed since, or is a part of it."""
    return None if dataset.numbers else find_root(dataset)


def as_model(model: str | Path, actuators: Actuators = "position") -> str:
    """Return a model as an argument of `find_robot`, with actuators for a URDF, which defines none."""
    return str(model) + (TORQUES if actuators == "torque" else "")


def as_models(models: Sequence[str | Path], actuators: Actuators) -> list[str]:
    """Return models to be compared, as `as_model` does; actuators concern the URDFs among them, if there is one."""
    urdfs = [Path(model).suffix == URDF for model in models]
    concerned = [urdf or not any(urdfs) for urdf in urdfs]
    return [as_model(model, actuators if its else "position") for model, its in zip(models, concerned, strict=True)]


def as_optional_model(model: str | Path | None, actuators: Actuators) -> str | None:
    """Return a model as `as_model` does; None without a model.

    Raises:
        OptionError: actuators are given without a model.
    """
    if model is not None:
        return as_model(model, actuators)
    if actuators != "position":
        raise OptionError("Actuators are for a URDF that is given as the model; without one, leave them out.")
    return None


def as_correction(report: GapReport | str | Path) -> ModelCorrection:
    """Return the named effects and retuned base parameters of a gap report.

    Args:
        report: In memory, its folder, or its `effects.json`.

    Raises:
        OptionError: there is no report.
    """
    if not isinstance(report, GapReport):
        return ModelCorrection.read(report)
    if EFFECTS not in report.files:
        raise OptionError(f"This report has no {EFFECTS}; give the folder that `nas gap` wrote.")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, EFFECTS)
        path.write_bytes(report.files[EFFECTS])
        return ModelCorrection.read(path)
