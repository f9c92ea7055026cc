"""Location of episodes in the videos of an interrupted recording that has no episode table yet.

LeRobot finishes a video with each saved episode, and writes its table every ten episodes. A video holds whole episodes
in order, so the frame counts tell where each one begins.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset import layout
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.passthrough_source import PassthroughSource
from nas_data.dataset.videos import VIDEO_PATH, VideoPlace
from nas_data.errors import DatasetInvalid

SHORT, LARGE = 4, 16  # [bytes] of the size of a box in an MP4 file; of a header with a 64-bit size


class FilmedSource(PassthroughSource):
    """A rescued dataset whose only pass-through features are videos."""

    def __init__(self, root: Path, episodes: np.ndarray, lengths: np.ndarray, fps: float) -> None:
        """Find the episodes in the videos.

        Args:
            root: The dataset; its `meta/info.json` is undamaged.
            episodes: Numbers of the episodes with rows, ascending, shape (E,).
            lengths: Number of rows of each, shape (E,).
            fps: Control rate [Hz].

        Raises:
            DatasetInvalid: an episode cannot be located.
        """
        super().__init__(root)
        info = DatasetInfo.read(root)
        if episodes.tolist() != list(range(len(episodes))):
            raise DatasetInvalid(
                "meta/episodes does not give the position of its video frames, and earlier rows are lost"
            )
        self._indices = np.repeat(episodes, lengths)
        entries: dict[int, dict[str, object]] = {
            int(episode): {"length": int(length)} for episode, length in zip(episodes, lengths, strict=True)
        }
        template = info.video_path or VIDEO_PATH
        for key in info.other_features:
            columns = VideoPlace.columns(key)
            for episode, place in enumerate(locate_episodes(root, key, template, lengths.tolist(), fps)):
                entries[episode] |= {column: getattr(place, name) for name, column in columns.items()}
        self._episodes = dict(entries)

    def files_of(self, rows: np.ndarray) -> list[Path]:
        """Return nothing: no data file holds videos."""
        return []

    def schema_metadata(self) -> dict[str, object]:
        """Return nothing, for the same reason."""
        return {}


def locate_episodes(root: Path, key: str, template: str, lengths: Sequence[int], fps: float) -> Iterator[VideoPlace]:
    """Yield file and time range of each episode in the videos of one camera.

    Raises:
        DatasetInvalid: frames are missing, or an episode would span two files.
    """
    chunk, file, begin, count = 0, 0, 0, -1
    for episode, length in enumerate(lengths):
        if count >= 0 and begin == count:
            chunk, file = (chunk, file + 1) if file + 1 < layout.FILES_PER_CHUNK else (chunk + 1, 0)
            begin, count = 0, -1
        place = VideoPlace(chunk, file, begin / fps, (begin + length) / fps)
        path = root / place.path(key, template)
        if count < 0:
            count = count_frames(path)
        if begin + length > count:
            raise DatasetInvalid(
                f"{path.relative_to(root)} has {count_of(count, 'frame')}, which do not include all of episode "
                f"{episode}"
            )
        yield place
        begin += length


def count_frames(path: Path) -> int:
    """Return the number of frames in a video file.

    Raises:
        DatasetInvalid: the file is missing, or its video is incomplete.
    """
    import av

    if not path.is_file():
        raise DatasetInvalid(f"{path} is missing")
    try:
        if is_complete_video(path):
            with av.open(str(path)) as container:
                return int(container.streams.video[0].frames)
    except (av.FFmpegError, LookupError):  # it holds no video
        pass
    raise DatasetInvalid(f"{path.name} is not a complete video file")


def is_complete_video(path: Path) -> bool:
    """Whether the boxes of an MP4 file end at the end of the file; a truncated one may still open."""
    end, length = 0, path.stat().st_size
    with path.open("rb") as stream:
        while end < length:
            stream.seek(end)
            header = stream.read(LARGE)
            size = int.from_bytes(header[:SHORT], "big")
            if size == 1:  # a 64-bit size follows the name
                size = int.from_bytes(header[2 * SHORT : LARGE], "big")
            if size < 2 * SHORT:
                return False
            end += size
    return end == length
