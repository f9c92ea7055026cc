"""Videos of a dataset: the part of a file that belongs to an episode, and links to files of other datasets."""

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from nas_data.dataset import layout

VIDEO = "video"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"


@dataclass(frozen=True)
class Clip:
    """The part of a video file that belongs to an episode.

    Attributes:
        file: The video.
        start: Start time in the video [s].
        stop: End time in the video [s].
    """

    file: Path
    start: float
    stop: float


@dataclass(frozen=True)
class VideoPlace:
    """Location of an episode in the videos of a camera; the episode table has a column for each entry.

    Attributes:
        chunk_index: Number of the file's folder.
        file_index: Number of the file in it.
        from_timestamp: Start time in the video [s].
        to_timestamp: End time in the video [s].
    """

    chunk_index: int
    file_index: int
    from_timestamp: float
    to_timestamp: float

    @staticmethod
    def columns(key: str) -> dict[str, str]:
        """Return the column of each entry for a camera."""
        return {item.name: f"videos/{key}/{item.name}" for item in fields(VideoPlace)}

    def path(self, key: str, template: str = VIDEO_PATH) -> str:
        """Return the path of the file in the dataset."""
        return template.format(video_key=key, chunk_index=self.chunk_index, file_index=self.file_index)


def place_videos(folder: Path, clips: Mapping[str, Sequence[Clip]]) -> tuple[dict[str, list[object]], dict[str, Path]]:
    """Hard-link the videos of clips into a dataset's folder; copy them if that fails.

    Args:
        folder: The dataset that is written.
        clips: One clip per episode, for each camera.

    Returns:
        Columns of the episode table, and the files by their path in the dataset.
    """
    columns: dict[str, list[object]] = {}
    files: dict[str, Path] = {}
    for key, parts in clips.items():
        numbers = {file: number for number, file in enumerate(dict.fromkeys(clip.file for clip in parts))}
        places = [
            VideoPlace(*divmod(numbers[clip.file], layout.FILES_PER_CHUNK), clip.start, clip.stop) for clip in parts
        ]
        for place, clip in zip(places, parts, strict=True):
            if (name := place.path(key)) not in files:
                link(clip.file, folder / name)
                files[name] = folder / name
        columns |= {
            column: [getattr(place, name) for place in places] for name, column in VideoPlace.columns(key).items()
        }
    return columns, files


def link(file: Path, target: Path) -> None:
    """Hard-link a file; copy it if the file system does not support that."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(file.resolve(), target)
    except OSError:
        shutil.copyfile(file, target)
