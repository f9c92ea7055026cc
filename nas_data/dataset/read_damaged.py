"""Reading of a damaged dataset's rows, also from files without a footer."""

import hashlib
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from nas_data.dataset import layout
from nas_data.dataset.features import Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.parquet import UNREADABLE, open_parquet
from nas_data.dataset.parquet_footer import rebuild_footer
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import Rows
from nas_data.errors import DatasetInvalid


@dataclass(frozen=True)
class ReadableRows:
    """The readable rows.

    Attributes:
        columns: Column of each feature and of LeRobot's indices, sorted by episode, shape (N, width).
        episodes: Numbers of the episodes with rows, ascending, shape (E,).
        lengths: Number of rows of each, shape (E,).
        files: Remarks on the data files, one sentence each.
    """

    columns: Mapping[str, np.ndarray]
    episodes: np.ndarray
    lengths: np.ndarray
    files: tuple[str, ...]

    def row_episodes(self) -> np.ndarray:
        """Return the index in `episodes` of each row's episode, shape (N,)."""
        return np.repeat(np.arange(len(self.episodes)), self.lengths)


def read_damaged_files(root: Path, info: DatasetInfo, provenance: Provenance | None) -> ReadableRows:
    """Read the readable part of every data file.

    Args:
        root: The damaged dataset.
        info: Content of its `meta/info.json`, or that of a dataset with equal features.
        provenance: Content of its `meta/nas.json`.
    """
    features = info.vector_features
    wanted = {**features, **{key: Feature((key,), dtype=layout.AUTOMATIC[key]) for key in layout.AUTOMATIC}}
    paths = layout.list_data_files(root)
    reader = _Files(root, wanted, _make_template(info, paths), provenance)
    parts = [rows for path in paths if (rows := reader.read(path))]
    empty = {key: np.empty((0, feature.width), feature.dtype) for key, feature in wanted.items()}
    columns = {key: np.concatenate([empty[key], *(part[key] for part in parts)]) for key in wanted}
    order = np.argsort(columns["episode_index"][:, 0], kind="stable")
    columns = {key: column[order] for key, column in columns.items()}
    episodes, lengths = np.unique(columns["episode_index"], return_counts=True)
    return ReadableRows(columns, episodes, lengths.astype(np.int64), tuple(reader.notes))


@dataclass
class _Files:
    """Reads data files one by one, and collects remarks on them."""

    root: Path
    features: Mapping[str, Feature]
    template: tuple[bytes, list[int]]
    provenance: Provenance | None
    notes: list[str] = field(default_factory=list)

    def read(self, path: Path) -> dict[str, np.ndarray] | None:
        """Return the rows of a file; None if nothing is readable."""
        name = path.relative_to(self.root).as_posix()
        recorded = self.provenance.files.get(name) if self.provenance else None
        content = path.read_bytes()
        if recorded and hashlib.sha256(content).hexdigest() != recorded:
            self.notes.append(
                f"{name} was changed after nas wrote it (its SHA-256 differs); its episodes were checked against their "
                "statistics"
            )
        try:
            open_parquet(path)
        except DatasetInvalid:
            return self._read_without_footer(name, content)
        return self._rows(name, path)

    def _read_without_footer(self, name: str, content: bytes) -> dict[str, np.ndarray] | None:
        """Return the rows of a file without footer."""
        whole, groups = rebuild_footer(content, *self.template)
        if not groups:
            self.notes.append(
                f"{name} has no valid Parquet footer (was its writer killed?) and contains no complete episode"
            )
            return None
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mended.parquet"
            path.write_bytes(whole)
            rows = self._rows(name, path)
        if rows is not None:
            self.notes.append(
                f"{name} has no valid Parquet footer (was its writer killed?); the footer was rebuilt from the data "
                "pages"
            )
        return rows

    def _rows(self, name: str, path: Path) -> dict[str, np.ndarray] | None:
        """Read a file with a footer: as a whole, or else by row group (episode)."""
        try:
            return Rows.read(self.root, self.features, [path]).columns
        except DatasetInvalid as error:
            reason = str(error).removeprefix(f"{path}")
        groups = list(self._read_row_groups(path))
        if not groups:
            self.notes.append(f"{name} cannot be read ({reason.strip(' ,').rstrip('.')})")
            return None
        count = pq.read_metadata(path).num_row_groups
        self.notes.append(f"{name} is damaged: {len(groups)} of its {count} row groups can be read")
        return {key: np.concatenate([group[key] for group in groups]) for key in self.features}

    def _read_row_groups(self, path: Path) -> Iterator[dict[str, np.ndarray]]:
        """Yield the readable row groups, each through a new file object."""
        file = pq.ParquetFile(path)
        with tempfile.TemporaryDirectory() as folder:
            alone = Path(folder) / "group.parquet"
            for group in range(file.metadata.num_row_groups):
                try:
                    pq.write_table(file.read_row_group(group), alone)
                    yield Rows.read(self.root, self.features, [alone]).columns
                except (DatasetInvalid, *UNREADABLE):
                    continue


def _make_template(info: DatasetInfo, files: Sequence[Path]) -> tuple[bytes, list[int]]:
    """Return a Parquet file of one row with LeRobot's columns, and the values per row of each leaf column.

    The column order is that of an undamaged file of the dataset, or else that of the feature descriptions.
    """
    types: dict[str, pa.DataType] = {}
    widths: list[int] = []
    entries = info.features
    order = _read_column_order(files)
    for key in order if set(order) == {key for key in entries if entries[key].get("dtype") != "video"} else entries:
        entry = entries[key]
        kind, shape = str(entry.get("dtype")), entry.get("shape")
        width = int(np.prod(np.asarray(shape if isinstance(shape, list) else [1])))
        if kind == "video":  # lies in files of its own
            continue
        if kind == "image":
            types[key] = pa.struct({"bytes": pa.binary(), "path": pa.string()})
            widths += [1, 1]
            continue
        item = pa.from_numpy_dtype(np.dtype(kind)) if kind in layout.NUMERIC else pa.string()
        types[key] = item if width == 1 else pa.list_(item, width)
        widths.append(width)
    rows = {key: pa.nulls(1, kind) for key, kind in types.items()}
    stream = io.BytesIO()
    pq.write_table(pa.table(rows), stream)
    return stream.getvalue(), widths


def _read_column_order(files: Sequence[Path]) -> list[str]:
    """Return the columns of the first undamaged file; empty if there is none."""
    for path in files:
        try:
            return open_parquet(path).schema_arrow.names
        except DatasetInvalid:
            continue
    return []
