"""File layout of LeRobot v3.0: paths and automatic columns."""

import json
from pathlib import Path

from nas_data.errors import DatasetInvalid
from nas_data.visible_files import list_visible_files

CODEBASE_VERSION = "v3.0"
INFO = "meta/info.json"
STATS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
SUBTASKS = "meta/subtasks.parquet"  # texts for the indices of a column subtask_index; LeRobot 0.4 reads it
PROVENANCE = "meta/nas.json"
SOURCE = "meta/source.xml"  # source model of a paired dataset
SOURCE_EFFECTS = "meta/source_effects.json"
CARD = "README.md"
DATA_TEMPLATE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_TEMPLATE = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FILES_PER_CHUNK = 1000
FILE_MEGABYTES = 100
VIDEO_FILE_MEGABYTES = 200  # LeRobot requires the entry even without videos.

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
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise DatasetInvalid(f"{path} cannot be read as JSON ({error}); restore it from a copy.") from None
    if not isinstance(content, dict):
        raise DatasetInvalid(f"{path} does not contain a JSON object; restore it from a copy.")
    return content
