"""Pass-through features that nas does not use: cameras, depth, language, texts, matrices.

Their values stay in the source files until a dataset is written. Videos are linked or copied, never encoded again.
Columns of data files are copied row by row.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.dataset import layout
from nas_data.dataset.descriptions import (
    LANGUAGE,
    Description,
    find_difference,
    make_common_description,
    make_schema_entry,
)
from nas_data.dataset.language import has_times, make_alike, move_times
from nas_data.dataset.parquet import open_parquet, read_parquet, try_parquet
from nas_data.dataset.videos import VIDEO, VIDEO_PATH, Clip, VideoPlace
from nas_data.errors import DatasetInvalid

VIDEO_LEFT_OUT = "LeRobot finds pictures by the rate at which they were filmed, and the dataset has another now"


@dataclass(frozen=True)
class Carried:
    """Pass-through features of N frames.

    Attributes:
        roots: Source datasets; they have the same pass-through features.
        rows: Source row of each frame, counted over the episodes of all roots in order, shape (N,).
        salvaged: Replaces the only root if its own files do not locate the episodes.
        kept: The features that are passed through; None for all that the first root has.
    """

    roots: tuple[Path, ...]
    rows: np.ndarray
    salvaged: "CarriedSource | None" = None
    kept: tuple[str, ...] | None = None

    @classmethod
    def of(cls, root: Path, frames: int) -> "Carried | None":
        """Return the pass-through features of a dataset; None if there are none, and no tools either."""
        info = layout.read_info(root)
        wanted = layout.describe_other_features(info) or layout.tools(info)
        return cls((root.resolve(),), np.arange(frames)) if wanted else None

    @classmethod
    def rescued(
        cls, root: Path, episodes: Sequence[int], lengths: np.ndarray, salvaged: "CarriedSource | None" = None
    ) -> "Carried | None":
        """Return the pass-through features of undamaged episodes in a damaged dataset.

        Args:
            root: The damaged dataset; its `meta/info.json` is whole.
            episodes: Numbers of the episodes.
            lengths: Frames of each episode, shape (E,).
            salvaged: Locates the episodes if the dataset does not.

        Raises:
            DatasetInvalid: a feature of an episode cannot be read.
        """
        found = cls.of(root, 0)
        if found is None:
            return None
        found = replace(found, salvaged=salvaged)
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
        described = [layout.read_feature_entries(info) for info in self._infos]
        keys = layout.describe_other_features(self._infos[0]) if self.kept is None else self.kept
        return {key: make_common_description([entries[key] for entries in described]) for key in keys}

    @property
    def tools(self) -> list[object]:
        """What the messages of the language columns may call, as LeRobot describes it, of all roots."""
        found: list[object] = []
        for tool in (tool for info in self._infos for tool in layout.tools(info)):
            found += [] if tool in found else [tool]
        return found

    @cached_property
    def _infos(self) -> tuple[Mapping[str, object], ...]:
        return tuple(layout.read_info(root) for root in self.roots)

    @property
    def frames(self) -> tuple[int, ...]:
        """Number of frames of each root."""
        return tuple(source.frames for source in self._sources)

    def take(self, chosen: np.ndarray) -> "Carried":
        """Return some of the frames."""
        return replace(self, rows=self.rows[chosen])

    def only(self, keys: Iterable[str]) -> "Carried":
        """Return the features of some keys."""
        return replace(self, kept=tuple(keys))

    def without_videos(self) -> "Carried":
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
            first: Their first frame.
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
            clocks = self._clocks(first + np.cumsum(lengths) - lengths, lengths, fps)
            if clocks is not None:
                found |= {key: move_times(found[key], clocks) for key in timed}
        return found

    def _clocks(
        self, starts: np.ndarray, lengths: np.ndarray, fps: float
    ) -> list[tuple[np.ndarray, np.ndarray]] | None:
        """Return each frame's episode in the source's clock and in its own [s]; None where no clock was moved."""
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
        """Return the video clip of each episode, for every camera that is stored as video.

        Args:
            starts: First frame of each episode, shape (E,).
            lengths: Number of frames of each episode, consecutive in its source, shape (E,).
            fps: Control rate [Hz].

        Raises:
            DatasetInvalid: a video is missing, or its place is not known.
        """
        cameras = [key for key, entry in self.features.items() if entry.get("dtype") == VIDEO]
        found: dict[str, list[Clip]] = {key: [] for key in cameras}
        if not cameras:
            return found
        for start, length in zip(starts, lengths, strict=True):
            source, row = self._find_source(int(self.rows[start]))
            for key in cameras:
                clip = source.clip(key, row, int(length), fps)
                if not clip.file.is_file():
                    raise DatasetInvalid(f"{clip.file} is missing{source.remedy(key)}.")
                found[key].append(clip)
        return found

    def check(self, starts: np.ndarray, lengths: np.ndarray) -> None:
        """Refuse episodes of which a video or a column is missing; arguments as above.

        Raises:
            DatasetInvalid: names what is missing.
        """
        self.clips(starts, lengths, 1.0)
        for source in self._sources if self._stored else ():
            source.check(self._stored)

    def statistics(self, starts: np.ndarray) -> list[Mapping[str, object]]:
        """Return the source's statistics of the episode in which each start frame lies, by column."""
        found: list[Mapping[str, object]] = []
        for start in starts if self.features else ():
            source, row = self._find_source(int(self.rows[start]))
            entry = source.episode(row)
            prefixes = tuple(f"stats/{key}/" for key in self.features)
            found.append({key: value for key, value in entry.items() if key.startswith(prefixes)})
        return found

    @cached_property
    def _sources(self) -> tuple["CarriedSource", ...]:
        return (self.salvaged,) if self.salvaged else tuple(CarriedSource(root) for root in self.roots)

    def _find_source(self, row: int) -> tuple["CarriedSource", int]:
        """Return the source of a row, and the row number in it."""
        for source in self._sources:
            if row < source.frames:
                return source, row
            row -= source.frames
        raise IndexError(row)


class CarriedSource:
    """A source dataset of pass-through features."""

    def __init__(self, root: Path) -> None:
        self.root = root

    @cached_property
    def frames(self) -> int:
        """Number of frames."""
        return len(self._order)

    @cached_property
    def fps(self) -> float:
        """Control rate [Hz]."""
        return float(str(layout.read_info(self.root)["fps"]))

    def row_bytes(self, keys: Sequence[str]) -> int:
        """Return the size of a row of some columns in memory, on average."""
        sizes = [open_parquet(path).metadata for path, _ in self._files]
        found = sum(
            column.total_uncompressed_size
            for metadata in sizes
            for group in range(metadata.num_row_groups)
            for column in map(metadata.row_group(group).column, range(metadata.num_columns))
            if column.path_in_schema.startswith(tuple(keys))
        )
        return -(-found // max(self.frames, 1))

    def rows_before(self, row: int) -> int:
        """Return how many rows of its episode are before a row."""
        return row - self._find_first_row(int(self._numbers[row]))

    def stamps(self, row: int) -> np.ndarray:
        """Return the time stamps [s] of the episode of a row; where the clock went back, it stands still."""
        number = int(self._numbers[row])
        return np.maximum.accumulate(self._stamps[self._find_first_row(number) : self._find_first_row(number + 1)])

    @cached_property
    def _stamps(self) -> np.ndarray:
        """Time stamp [s] of each row, in episode order, shape (N,)."""
        return np.asarray(self.rows(["timestamp"], np.arange(self.frames))["timestamp"], np.float64)

    def rows(self, keys: Sequence[str], rows: np.ndarray) -> pa.Table:
        """Return columns of some rows, in the order of the episodes."""

        def read(path: Path, wanted: np.ndarray) -> pa.Table:
            table = read_parquet(path, keys)
            self.check_columns(path, keys, table.column_names)
            return table.take(wanted)

        return take_rows(self._order[rows], [(len(numbers), partial(read, path)) for path, numbers in self._files])

    def check(self, keys: Sequence[str]) -> None:
        """Refuse data files without columns that `meta/info.json` promises.

        Raises:
            DatasetInvalid: names file and column.
        """
        for path, _ in self._files:
            self.check_columns(path, keys, open_parquet(path).schema_arrow.names)

    def check_columns(self, path: Path, keys: Sequence[str], present: Sequence[str]) -> None:
        """Refuse a data file whose columns lack one of the keys."""
        missing = next((key for key in keys if key not in present), None)
        if missing is not None:
            raise DatasetInvalid(f"{path} has no column '{missing}'{self.remedy(missing)}.")

    def remedy(self, key: str) -> str:
        """Return what helps where a feature is not all there."""
        return f"; restore it from a copy, or take '{key}' out of 'features' in {self.root / layout.INFO}"

    def schema_metadata(self) -> dict[str, object]:
        """Return the column descriptions of the data files for `datasets`."""
        metadata = open_parquet(self._files[0][0]).schema_arrow.metadata or {}
        try:
            content = json.loads(metadata[b"huggingface"])
            return dict(content["info"]["features"])
        except (KeyError, ValueError, TypeError):
            return {}

    def clip(self, key: str, row: int, length: int, fps: float) -> Clip:
        """Return the video clip of consecutive frames of an episode."""
        entry, number = self.episode(row), int(self._numbers[row])
        columns = VideoPlace.columns(key)
        if columns["chunk_index"] not in entry:
            table = self.root / "meta/episodes"
            raise DatasetInvalid(f"{table} does not say where the pictures of episode {number} lie{self.remedy(key)}.")
        place = VideoPlace(**{name: entry[column] for name, column in columns.items()})  # type: ignore[arg-type]  # as stored
        template = str(layout.read_info(self.root).get("video_path") or VIDEO_PATH)
        start = place.from_timestamp + (row - self._find_first_row(number)) / fps
        stop = place.to_timestamp if length == entry["length"] else start + length / fps
        return Clip(self.root / place.path(key, template), start, stop)

    def episode(self, row: int) -> Mapping[str, object]:
        """Return the entry of the episode table for the episode of a row; empty if it is damaged."""
        return self._episodes.get(int(self._numbers[row]), {})

    def first_row(self, episode: int, length: int) -> int:
        """Return the first row of an episode.

        Raises:
            DatasetInvalid: the readable files hold another number of its frames than `length`.
        """
        first = self._find_first_row(episode)
        if self._find_first_row(episode + 1) - first != length:
            raise DatasetInvalid(f"the data file of episode {episode} is damaged")
        return first

    def files_of(self, rows: np.ndarray) -> list[Path]:
        """Return the data files that hold some rows."""
        stops = np.cumsum([len(numbers) for _, numbers in self._files])
        return [self._files[index][0] for index in np.unique(np.searchsorted(stops, self._order[rows], side="right"))]

    def _find_first_row(self, episode: int) -> int:
        return int(np.searchsorted(self._numbers, episode))

    @cached_property
    def _files(self) -> list[tuple[Path, np.ndarray]]:
        """The readable data files, each with the episode number of its rows."""
        tables = [(path, try_parquet(path, ["episode_index"])) for path in layout.list_data_files(self.root)]
        return [(path, table["episode_index"].to_numpy()) for path, table in tables if table is not None]

    @cached_property
    def _indices(self) -> np.ndarray:
        """Episode number of each row, in file order, shape (N,)."""
        return np.concatenate([np.empty(0, np.int64), *(numbers for _, numbers in self._files)])

    @cached_property
    def _order(self) -> np.ndarray:
        """Indices that sort the rows of the files by episode, shape (N,)."""
        return np.argsort(self._indices, kind="stable")

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Episode number of each row, in episode order, shape (N,)."""
        return self._indices[self._order]

    @cached_property
    def _episodes(self) -> dict[int, Mapping[str, object]]:
        """Readable entries of the episode table, by episode number."""
        tables = [try_parquet(path) for path in layout.list_episode_files(self.root)]
        return {int(row["episode_index"]): row for table in tables if table for row in table.to_pylist()}


def take_rows(wanted: np.ndarray, tables: Sequence[tuple[int, Callable[[np.ndarray], pa.Table]]]) -> pa.Table:
    """Return rows of consecutive tables, in any order; only tables with such rows are read.

    Args:
        wanted: Row numbers, counted over all tables.
        tables: Number of rows of each table, and a function that returns some of its rows.
    """
    parts, places, offset = [], [], 0
    for count, take in tables:
        here = np.flatnonzero((wanted >= offset) & (wanted < offset + count))
        if here.size:
            parts.append(take(wanted[here] - offset))
            places.append(here)
        offset += count
    return join_tables(parts).take(np.argsort(np.concatenate(places)))


def join_tables(parts: Sequence[pa.Table]) -> pa.Table:
    """Return tables of the same columns after one another; values stay as they are."""
    names = parts[0].column_names
    columns = {name: make_alike([part[name] for part in parts]) for name in names}
    alike = [pa.table({name: columns[name][number] for name in names}) for number in range(len(parts))]
    return pa.concat_tables(alike, promote_options="permissive")


def shared_features(carried: Sequence[Carried | None]) -> list[str]:
    """Return the features that all have and that mean the same in all."""
    described = [part.features if part else {} for part in carried]
    first, *others = described
    return [
        key
        for key, entry in first.items()
        if all(key in other and find_difference(entry, other[key]) is None for other in others)
    ]


def combine_statistics(episodes: Sequence[Mapping[str, object]]) -> dict[str, dict[str, object]]:
    """Combine the statistics of episodes as LeRobot does: exactly, except that quantiles are averaged.

    Args:
        episodes: For each episode, `stats/<feature>/<statistic>` → values.
    """
    joined: dict[str, dict[str, object]] = {}
    for key, names in _list_shared_statistics(episodes):
        values = {name: np.array([entry[f"stats/{key}/{name}"] for entry in episodes], float) for name in names}
        if not {"min", "max", "mean", "std", "count"} <= values.keys():
            continue
        count = values["count"].reshape(len(episodes), -1)[:, :1].reshape(-1, *[1] * (values["mean"].ndim - 1))
        weights = count / count.sum()
        mean = (weights * values["mean"]).sum(0)
        variance = (weights * (values["std"] ** 2 + (values["mean"] - mean) ** 2)).sum(0)
        result = {name: (weights * column).sum(0) for name, column in values.items() if name.startswith("q")}
        result |= {"min": values["min"].min(0), "max": values["max"].max(0), "mean": mean, "std": np.sqrt(variance)}
        joined[key] = {name: column.tolist() for name, column in result.items()}
        joined[key]["count"] = [int(count.sum())]
    return joined


def _list_shared_statistics(episodes: Sequence[Mapping[str, object]]) -> Iterator[tuple[str, list[str]]]:
    """Yield each feature with the names of the statistics that all episodes have."""
    shared = [key for key in episodes[0] if all(entry.get(key) is not None for entry in episodes)] if episodes else []
    keys = dict.fromkeys(name.removeprefix("stats/").rpartition("/")[0] for name in shared)
    for key in keys:
        yield key, [name.rpartition("/")[2] for name in shared if name.startswith(f"stats/{key}/")]
