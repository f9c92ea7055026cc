"""Pass-through features that nas does not use: cameras, depth, language, texts, matrices.

Their values stay in the source files until a dataset is written. Videos are linked or copied, never encoded again.
Columns of data files are copied row by row.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.dataset.descriptions import (
    LANGUAGE,
    Description,
    find_difference,
    make_common_description,
    make_schema_entry,
)
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.language import has_times, move_times
from nas_data.dataset.parquet import read_parquet
from nas_data.dataset.passthrough_source import PassthroughSource, take_rows
from nas_data.dataset.videos import VIDEO, Clip
from nas_data.errors import VideosMissing

SHOWN = 5  # most missing files in a message
VIDEO_LEFT_OUT = "LeRobot finds video frames by the rate of the video, and the dataset now has a different rate"


@dataclass(frozen=True)
class PassthroughFeatures:
    """Pass-through features of N frames.

    Attributes:
        roots: Source datasets; they have the same pass-through features.
        rows: Source row of each frame, counted over the episodes of all roots in order, shape (N,).
        rescued_source: Replaces the only root if its own files do not locate the episodes.
        kept: Keys of the passed features; None for all of the first root.
    """

    roots: tuple[Path, ...]
    rows: np.ndarray
    rescued_source: PassthroughSource | None = None
    kept: tuple[str, ...] | None = None

    @classmethod
    def of(cls, root: Path, frames: int) -> "PassthroughFeatures | None":
        """Return the pass-through features of a dataset; None if there are neither features nor tools."""
        info = DatasetInfo.read(root)
        wanted = info.other_features or info.tools
        return cls((root.resolve(),), np.arange(frames)) if wanted else None

    @classmethod
    def rescued(
        cls, root: Path, episodes: Sequence[int], lengths: np.ndarray, rescued_source: PassthroughSource | None = None
    ) -> "PassthroughFeatures | None":
        """Return the pass-through features of undamaged episodes in a damaged dataset.

        Args:
            root: The damaged dataset; its `meta/info.json` is undamaged.
            episodes: Numbers of the episodes.
            lengths: Frames of each episode, shape (E,).
            rescued_source: Locates the episodes if the dataset does not.

        Raises:
            DatasetInvalid: a feature of an episode cannot be read.
        """
        found = cls.of(root, 0)
        if found is None:
            return None
        found = replace(found, rescued_source=rescued_source)
        (source,) = found._sources
        starts = np.array(
            [source.first_row(episode, length) for episode, length in zip(episodes, lengths, strict=True)]
        )
        found = replace(found, rows=np.concatenate([np.arange(a, a + n) for a, n in zip(starts, lengths, strict=True)]))
        found.check(np.cumsum(lengths) - lengths, lengths)
        for path in source.files_of(found.rows):
            read_parquet(path, list(found.features))
        return found

    @cached_property
    def features(self) -> dict[str, Description]:
        """LeRobot's description of each feature."""
        described = [info.features for info in self._infos]
        keys = self._infos[0].other_features if self.kept is None else self.kept
        return {key: make_common_description([entries[key] for entries in described]) for key in keys}

    @property
    def tools(self) -> list[object]:
        """Tools that messages of the language columns of all roots may call, as LeRobot describes them."""
        found: list[object] = []
        for tool in (tool for info in self._infos for tool in info.tools or ()):
            found += [] if tool in found else [tool]
        return found

    @cached_property
    def _infos(self) -> tuple[DatasetInfo, ...]:
        return tuple(DatasetInfo.read(root) for root in self.roots)

    @property
    def frames(self) -> tuple[int, ...]:
        """Number of frames of each root."""
        return tuple(source.frames for source in self._sources)

    def take(self, chosen: np.ndarray) -> "PassthroughFeatures":
        """Return the features of some frames."""
        return replace(self, rows=self.rows[chosen])

    def only(self, keys: Iterable[str]) -> "PassthroughFeatures":
        """Return the features with some keys."""
        return replace(self, kept=tuple(keys))

    def without_videos(self) -> "PassthroughFeatures":
        """Return the features that are not videos."""
        return self.only(key for key, entry in self.features.items() if entry.get("dtype") != VIDEO)

    @property
    def _stored(self) -> list[str]:
        """Features with a column in the data files."""
        return [key for key, entry in self.features.items() if entry.get("dtype") != VIDEO]

    @property
    def row_bytes(self) -> int:
        """Size of a row of the columns in memory, on average."""
        return max((source.row_bytes(self._stored) for source in self._sources), default=0) if self._stored else 0

    def columns(self, first: int, lengths: np.ndarray, fps: float) -> dict[str, pa.ChunkedArray]:
        """Return the columns of consecutive episodes as LeRobot stores them; videos have none.

        Args:
            first: First frame of the episodes.
            lengths: Number of frames of each episode, consecutive in its source, shape (E,).
            fps: Control rate [Hz].
        """
        keys, wanted = self._stored, self.rows[first : first + int(lengths.sum())]
        if not keys or not len(wanted):
            return {}
        table = take_rows(wanted, [(source.frames, partial(source.rows, keys)) for source in self._sources])
        found = {key: table[key] for key in keys}
        timed = [key for key in keys if self.features[key].get("dtype") == LANGUAGE and has_times(found[key])]
        if timed:
            clocks = self._find_clocks(first + np.cumsum(lengths) - lengths, lengths, fps)
            if clocks is not None:
                found |= {key: move_times(found[key], clocks) for key in timed}
        return found

    def _find_clocks(
        self, starts: np.ndarray, lengths: np.ndarray, fps: float
    ) -> list[tuple[np.ndarray, np.ndarray]] | None:
        """Return for each frame the times [s] of its episode in source and result; None if all are equal."""
        sources = [self._find_source(int(self.rows[start])) for start in starts]
        if all(source.rows_before(row) == 0 and source.fps == fps for source, row in sources):
            return None
        clocks = []
        for (source, row), length in zip(sources, lengths.tolist(), strict=True):
            stamps = source.stamps(row)
            clocks += [(stamps, (np.arange(len(stamps)) - source.rows_before(row)) / fps)] * length
        return clocks

    def huggingface(self) -> dict[str, object]:
        """Return the description of the columns for `datasets.Features`."""
        written = self._sources[0].schema_metadata() if self._stored else {}
        known = {key: written.get(key) or make_schema_entry(self.features[key]) for key in self._stored}
        return {key: entry for key, entry in known.items() if entry}

    def clips(self, starts: np.ndarray, lengths: np.ndarray, fps: float) -> dict[str, list[Clip]]:
        """Return the clip of each episode for every camera that is stored as video.

        Args:
            starts: First frame of each episode, shape (E,).
            lengths: Number of frames of each episode, consecutive in its source, shape (E,).
            fps: Control rate [Hz].

        Raises:
            VideosMissing: video files are missing.
            DatasetInvalid: the table of episodes does not give their places in the videos.
        """
        cameras = [key for key, entry in self.features.items() if entry.get("dtype") == VIDEO]
        found: dict[str, list[Clip]] = {key: [] for key in cameras}
        if not cameras:
            return found
        missing: dict[PassthroughSource, dict[Path, str]] = {}  # cameras by file
        for start, length in zip(starts, lengths, strict=True):
            source, row = self._find_source(int(self.rows[start]))
            for key in cameras:
                clip = source.clip(key, row, int(length), fps)
                if not clip.file.is_file():
                    missing.setdefault(source, {})[clip.file] = key
                found[key].append(clip)
        for source, files in missing.items():
            shown, more = ", ".join(map(str, list(files)[:SHOWN])), len(files) - SHOWN
            what = f"{shown} and {more} more are" if more > 0 else f"{shown} {'is' if len(files) == 1 else 'are'}"
            lost = "it" if len(files) == 1 else "them"
            raise VideosMissing(f"{what} missing{source.remedy(*dict.fromkeys(files.values()), lost=lost)}.")
        return found

    def check(self, starts: np.ndarray, lengths: np.ndarray) -> None:
        """Refuse episodes without one of their videos or columns; arguments as for `clips`.

        Raises:
            DatasetInvalid: names what is missing.
        """
        self.clips(starts, lengths, 1.0)
        for source in self._sources if self._stored else ():
            source.check(self._stored)

    def statistics(self, starts: np.ndarray) -> list[Mapping[str, object]]:
        """Return the source's statistics of the episode of each start frame, by column."""
        found: list[Mapping[str, object]] = []
        for start in starts if self.features else ():
            source, row = self._find_source(int(self.rows[start]))
            entry = source.episode(row)
            prefixes = tuple(f"stats/{key}/" for key in self.features)
            found.append({key: value for key, value in entry.items() if key.startswith(prefixes)})
        return found

    @cached_property
    def _sources(self) -> tuple[PassthroughSource, ...]:
        return (self.rescued_source,) if self.rescued_source else tuple(PassthroughSource(root) for root in self.roots)

    def _find_source(self, row: int) -> tuple[PassthroughSource, int]:
        """Return the source of a row, and the row number in it."""
        ends = np.cumsum(self.frames)
        index = int(np.searchsorted(ends, row, side="right"))
        return self._sources[index], row - int(ends[index]) + self.frames[index]


def shared_features(passthrough: Sequence[PassthroughFeatures | None]) -> list[str]:
    """Return the features that all have with the same meaning."""
    described = [part.features if part else {} for part in passthrough]
    first, *others = described
    return [
        key
        for key, entry in first.items()
        if all(key in other and find_difference(entry, other[key]) is None for other in others)
    ]
