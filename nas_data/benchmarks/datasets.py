"""Datasets for the benchmarks: written as `nas record sim` and `nas pair` do, and by LeRobot itself."""

import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.api.pairing import pair
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import Feature
from nas_data.dataset.origin import describe
from nas_data.dataset.versions import save
from nas_data.errors import MissingPackage

if TYPE_CHECKING:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset


def write_version(dataset: Dataset, out: Path) -> Path:
    """Write a dataset with its provenance and its source; return the folder."""
    provenance, kept = describe(dataset)
    return save(dataset, provenance, out=out, attachments=kept)


def pair_folder(root: Path, model: str, out: Path) -> Path:
    """Pair a recorded dataset with a robot as source; return the folder."""
    return write_version(pair(root, model), out)


NAME = "local/benchmark"


@contextmanager
def lerobot(scratch: Path) -> Iterator["type[LeRobotDataset]"]:
    """Yield LeRobot's dataset class: offline, without progress bars, with its Arrow cache in a scratch folder.

    Raises:
        MissingPackage: LeRobot is not installed.
    """
    # LeRobot and `datasets` read both variables at import.
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    os.environ.setdefault("HF_DATASETS_DISABLE_PROGRESS_BARS", "1")
    try:
        import datasets.config
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
    except ImportError as error:
        raise MissingPackage(f"This benchmark compares with LeRobot, which is not installed ({error}).") from None
    before = datasets.config.HF_DATASETS_CACHE
    datasets.config.HF_DATASETS_CACHE = scratch / "cache"
    try:
        with warnings.catch_warnings():
            # LeRobot turns progress bars on again after each load, which the variable above forbids.
            warnings.filterwarnings("ignore", message="Cannot enable progress bars")
            yield LeRobotDataset
    finally:
        datasets.config.HF_DATASETS_CACHE = before


def create(
    kind: "type[LeRobotDataset]", root: Path, features: Mapping[str, Feature], fps: float, robot: str
) -> "LeRobotDataset":
    """Create an empty dataset, to be filled by `add_frame`, `save_episode` and `finalize`."""
    described = {key: {**feature.to_info(), "shape": (feature.width,)} for key, feature in features.items()}
    rate = int(fps) if float(fps).is_integer() else fps
    return kind.create(NAME, rate, described, root=root, robot_type=robot, use_videos=False, video_backend="pyav")


def open_dataset(kind: "type[LeRobotDataset]", root: Path) -> "LeRobotDataset":
    """Open a dataset for reading by `dataset[i]`."""
    return kind(NAME, root=root, video_backend="pyav")
