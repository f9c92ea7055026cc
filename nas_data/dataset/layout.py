"""File layout of LeRobot v3.0: paths, automatic columns and `meta/info.json`."""

import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path

from nas_data.dataset.descriptions import describe_kind
from nas_data.dataset.features import Feature
from nas_data.errors import DatasetInvalid, DatasetNotFound
from nas_data.visible_files import list_visible_files

CODEBASE_VERSION = "v3.0"
CONVERTER = "convert_dataset_v21_to_v30"
INFO = "meta/info.json"
STATS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
SUBTASKS = "meta/subtasks.parquet"  # texts that a column subtask_index counts; LeRobot 0.4 reads it
PROVENANCE = "meta/nas.json"
SOURCE = "meta/source.xml"  # the model that predicted a paired dataset
SOURCE_EFFECTS = "meta/source_effects.json"
CARD = "README.md"
DATA_TEMPLATE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_TEMPLATE = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FILES_PER_CHUNK = 1000
FILE_MEGABYTES = 100
VIDEO_FILE_MEGABYTES = 200  # LeRobot wants the entry although we store no video.

AUTOMATIC = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
NUMERIC = {"bool", "float16", "float32", "float64"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def make_numbered_path(template: str, number: int) -> str:
    """Return the path of the file with a running number; a chunk has 1000 files."""
    return template.format(chunk_index=number // FILES_PER_CHUNK, file_index=number % FILES_PER_CHUNK)


def list_data_files(root: Path) -> list[Path]:
    """Return the data files in LeRobot's row order: sorted by path."""
    return list_visible_files(root / "data", "*/*.parquet")


def list_episode_files(root: Path) -> list[Path]:
    """Return the files of the episode table in order."""
    return list_visible_files(root / "meta" / "episodes", "*/*.parquet")


def read_json(path: Path) -> dict[str, object]:
    """Read a JSON object.

    Raises:
        DatasetInvalid: the file is no JSON object.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DatasetInvalid(f"{path} cannot be read as JSON ({error}); restore it from a copy.") from None
    if not isinstance(content, dict):
        raise DatasetInvalid(f"{path} holds no JSON object; restore it from a copy.")
    return content


def read_info(root: Path) -> dict[str, object]:
    """Read `meta/info.json`.

    Raises:
        DatasetNotFound: there is no dataset at the path.
        DatasetInvalid: the file is damaged or of another format version.
    """
    if not (root / INFO).is_file():
        what = "there is no such folder" if not root.exists() else f"it has no {INFO}"
        raise DatasetNotFound(f"There is no dataset at {root}: {what}; give a folder that LeRobot or nas wrote.")
    info = read_json(root / INFO)
    version = str(info.get("codebase_version"))
    if not version.startswith("v3."):
        older = "" if version == "v2.1" else ", after LeRobot 0.3's convert_dataset_v20_to_v21 made it a v2.1"
        raise DatasetInvalid(
            f"{root / INFO} says codebase_version {version}; v3.0 is needed: convert it{older} with "
            f"'python -m {find_converter()} --repo-id=. --root={root} --push-to-hub=false', which keeps it as "
            f"{root}_old."
        )
    if not isinstance(info.get("features"), dict) or not _is_rate(info.get("fps")):
        raise DatasetInvalid(f"{root / INFO} lacks features or a positive fps; restore it from a copy.")
    return info


def find_converter() -> str:
    """Return the module of the installed LeRobot that converts v2.1 to v3.0; it differs between 0.4 and 0.6."""
    lerobot = importlib.util.find_spec("lerobot")
    places = (lerobot and lerobot.submodule_search_locations) or []
    is_new = any((Path(place) / "scripts" / f"{CONVERTER}.py").is_file() for place in places)
    return f"lerobot.{'scripts' if is_new else 'datasets.v30'}.{CONVERTER}"


def _is_rate(value: object) -> bool:
    return isinstance(value, int | float) and value > 0


def read_feature_entries(info: Mapping[str, object]) -> dict[str, Mapping[str, object]]:
    """Return LeRobot's description of each feature."""
    features = info["features"]
    assert isinstance(features, Mapping)
    return {str(key): value for key, value in features.items() if isinstance(value, Mapping)}


def select_vector_features(info: Mapping[str, object]) -> dict[str, Feature]:
    """Return the features that a dataset in memory holds: numeric vectors that are not automatic columns."""
    return {
        key: Feature.from_info(key, entry)
        for key, entry in read_feature_entries(info).items()
        if key not in AUTOMATIC and _is_vector(entry)
    }


def describe_other_features(info: Mapping[str, object]) -> dict[str, str]:
    """Return the features that are not vectors of numbers (images, videos, strings, matrices) with their type."""
    kept = select_vector_features(info)
    return {
        key: describe_kind(entry)
        for key, entry in read_feature_entries(info).items()
        if key not in AUTOMATIC and key not in kept
    }


def tools(info: Mapping[str, object]) -> list[object]:
    """Return what the messages of language columns may call, as LeRobot describes it."""
    found = info.get("tools")
    return found if isinstance(found, list) else []


def _is_vector(entry: Mapping[str, object]) -> bool:
    shape = entry.get("shape")
    return str(entry.get("dtype")) in NUMERIC and isinstance(shape, list) and len(shape) <= 1


def read_total(info: Mapping[str, object], key: str) -> int:
    """Return one of the totals of `meta/info.json`, or -1 if it is missing."""
    value = info.get(key)
    return value if isinstance(value, int) else -1
