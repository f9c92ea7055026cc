"""`meta/info.json`: LeRobot v3.0's description of a dataset."""

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nas_data.dataset.descriptions import Description, describe_kind
from nas_data.dataset.features import Feature
from nas_data.dataset.layout import (
    AUTOMATIC,
    CODEBASE_VERSION,
    DATA_TEMPLATE,
    FILE_MEGABYTES,
    FILES_PER_CHUNK,
    INFO,
    NUMERIC,
    VIDEO_FILE_MEGABYTES,
    read_json,
)
from nas_data.errors import DatasetInvalid, DatasetNotFound
from nas_data.typed_json import FormError, from_json

CONVERTER = "convert_dataset_v21_to_v30"


@dataclass(frozen=True, kw_only=True)
class DatasetInfo:
    """Content of `meta/info.json`.

    Attributes:
        codebase_version: Version of the format.
        robot_type: Name of the robot; None if unknown.
        total_episodes: Number of episodes; -1 if unknown, like the following two.
        total_frames: Number of frames.
        total_tasks: Number of tasks.
        chunks_size: Files in a folder.
        data_files_size_in_mb: Size at which a data file is full [MB].
        video_files_size_in_mb: Size at which a video file is full [MB].
        fps: Control rate [Hz].
        splits: Range of episodes of each split.
        data_path: Template of the paths of data files.
        video_path: Template of the paths of videos; None without videos.
        features: LeRobot's description of each feature.
        tools: Tools that messages of language columns may call, as LeRobot describes them.
    """

    codebase_version: str = CODEBASE_VERSION
    robot_type: str | None = None
    total_episodes: int = -1
    total_frames: int = -1
    total_tasks: int = -1
    chunks_size: int = FILES_PER_CHUNK
    data_files_size_in_mb: float = FILE_MEGABYTES
    video_files_size_in_mb: float = VIDEO_FILE_MEGABYTES
    fps: float
    splits: Mapping[str, object] = field(default_factory=dict)
    data_path: str | None = DATA_TEMPLATE
    video_path: str | None = None
    features: Mapping[str, Description]
    tools: tuple[object, ...] | None = field(default=None, metadata={"optional": True})

    @classmethod
    def read(cls, root: Path) -> "DatasetInfo":
        """Read the file of a dataset; an entry that is null counts as missing.

        Raises:
            DatasetNotFound: there is no dataset at the path.
            DatasetInvalid: the file is damaged or of another format version.
        """
        path = root / INFO
        if not path.is_file():
            what = "there is no such folder" if not root.exists() else f"it has no {INFO}"
            raise DatasetNotFound(f"There is no dataset at {root}: {what}; give a folder that LeRobot or nas wrote.")
        content = read_json(path)
        version = str(content.get("codebase_version"))
        if not version.startswith("v3."):
            older = "" if version == "v2.1" else ", after LeRobot 0.3's convert_dataset_v20_to_v21 made it a v2.1"
            raise DatasetInvalid(
                f"{path} says codebase_version {version}; v3.0 is needed: convert it{older} with "
                f"'python -m {find_converter()} --repo-id=. --root={root} --push-to-hub=false', which keeps it as "
                f"{root}_old."
            )
        try:
            info = from_json(cls, {key: value for key, value in content.items() if value is not None})
        except FormError as error:
            raise DatasetInvalid(f"{path} is damaged ({error}); restore it from a copy.") from None
        if info.fps <= 0:
            raise DatasetInvalid(f"{path} lacks a positive fps; restore it from a copy.")
        return info

    @property
    def vector_features(self) -> dict[str, Feature]:
        """The features that a dataset in memory holds: numeric vectors that are not automatic columns."""
        return {
            key: Feature.from_info(key, entry)
            for key, entry in self.features.items()
            if key not in AUTOMATIC and is_vector(entry)
        }

    @property
    def other_features(self) -> dict[str, str]:
        """The features that are not vectors of numbers (images, videos, strings, matrices) with their type."""
        return {
            key: describe_kind(entry)
            for key, entry in self.features.items()
            if key not in AUTOMATIC and not is_vector(entry)
        }


def is_vector(entry: Description) -> bool:
    """Whether LeRobot describes a vector of numbers."""
    shape = entry.get("shape")
    return str(entry.get("dtype")) in NUMERIC and isinstance(shape, list) and len(shape) <= 1


def find_converter() -> str:
    """Return the module of the installed LeRobot that converts v2.1 to v3.0; it differs between 0.4 and 0.6."""
    lerobot = importlib.util.find_spec("lerobot")
    places = (lerobot and lerobot.submodule_search_locations) or []
    is_new = any((Path(place) / "scripts" / f"{CONVERTER}.py").is_file() for place in places)
    return f"lerobot.{'scripts' if is_new else 'datasets.v30'}.{CONVERTER}"
