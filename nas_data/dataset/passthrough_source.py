"""A source dataset of pass-through features: its files, rows, clips and episode table."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.dataset import layout
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.language import unify_types
from nas_data.dataset.parquet import open_parquet, read_parquet, try_parquet
from nas_data.dataset.videos import VIDEO_PATH, Clip, VideoPlace
from nas_data.errors import DatasetInvalid


class PassthroughSource:
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
        return DatasetInfo.read(self.root).fps

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
        """Return the number of rows before a row in its episode."""
        return row - self._find_first_row(int(self._numbers[row]))

    def stamps(self, row: int) -> np.ndarray:
        """Return the time stamps [s] of a row's episode; decreasing ones are replaced by the last larger one."""
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

    def remedy(self, *keys: str, lost: str = "it") -> str:
        """Return the remedy for incomplete features; `lost` names what is missing, as a pronoun."""
        named = ", ".join(f"'{key}'" for key in keys)
        return f"; restore {lost} from a copy, or take {named} out of 'features' in {self.root / layout.INFO}"

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
            raise DatasetInvalid(
                f"{table} does not give the position of the video frames of episode {number}{self.remedy(key)}."
            )
        place = VideoPlace(**{name: entry[column] for name, column in columns.items()})  # type: ignore[arg-type]  # as stored
        template = DatasetInfo.read(self.root).video_path or VIDEO_PATH
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
    """Concatenate tables with the same columns; values stay unchanged."""
    names = parts[0].column_names
    columns = {name: unify_types([part[name] for part in parts]) for name in names}
    alike = [pa.table({name: columns[name][number] for name in names}) for number in range(len(parts))]
    return pa.concat_tables(alike, promote_options="permissive")
