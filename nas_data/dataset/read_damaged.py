"""The rows of a damaged dataset that can still be read, from files without a footer too."""

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
from nas_data.dataset.parquet import UNREADABLE, open_parquet
from nas_data.dataset.parquet_footer import mend
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import Rows
from nas_data.errors import DatasetInvalid


@dataclass(frozen=True)
class Salvage:
    """What can be read.

    Attributes:
        columns: Column of each feature and of LeRobot's indices, rows in the order of episodes, shape (N, width).
        episodes: Number of each episode of which there are rows, ascending, shape (E,).
        lengths: Its rows, shape (E,).
        files: What is to be said of the data files, one sentence each.
    """

    columns: Mapping[str, np.ndarray]
    episodes: np.ndarray
    lengths: np.ndarray
    files: tuple[str, ...]

    def row_episodes(self) -> np.ndarray:
        """Return the index in `episodes` of each row's episode, shape (N,)."""
        return np.repeat(np.arange(len(self.episodes)), self.lengths)


def salvage(root: Path, info: Mapping[str, object], provenance: Provenance | None) -> Salvage:
    """Read every data file as far as it can be read.

    Args:
        root: The damaged dataset.
        info: What `meta/info.json` says, or that of a dataset recorded alike.
        provenance: What `meta/nas.json` says.
    """
    features = layout.vector_features(info)
    wanted = {**features, **{key: Feature((key,), dtype=layout.AUTOMATIC[key]) for key in layout.AUTOMATIC}}
    paths = layout.data_files(root)
    reader = _Files(root, wanted, _template(info, paths), provenance)
    parts = [rows for path in paths if (rows := reader.read(path))]
    empty = {key: np.empty((0, feature.width), feature.dtype) for key, feature in wanted.items()}
    columns = {key: np.concatenate([empty[key], *(part[key] for part in parts)]) for key in wanted}
    order = np.argsort(columns["episode_index"][:, 0], kind="stable")
    columns = {key: column[order] for key, column in columns.items()}
    episodes, lengths = np.unique(columns["episode_index"], return_counts=True)
    return Salvage(columns, episodes, lengths.astype(np.int64), tuple(reader.notes))


@dataclass
class _Files:
    """Reads data files one by one, and notes what is wrong with them."""

    root: Path
    features: Mapping[str, Feature]
    template: tuple[bytes, list[int]]
    provenance: Provenance | None
    notes: list[str] = field(default_factory=list)

    def read(self, path: Path) -> dict[str, np.ndarray] | None:
        """Return the rows of a file, None where there are none to be had."""
        name = path.relative_to(self.root).as_posix()
        recorded = self.provenance.files.get(name) if self.provenance else None
        content = path.read_bytes()
        if recorded and hashlib.sha256(content).hexdigest() != recorded:
            self.notes.append(
                f"{name} was changed after nas wrote it (its SHA-256 differs); its episodes were judged by their "
                "statistics"
            )
        try:
            open_parquet(path)
        except DatasetInvalid:
            return self._mended(name, content)
        return self._rows(name, path)

    def _mended(self, name: str, content: bytes) -> dict[str, np.ndarray] | None:
        """Return the rows of a file without footer."""
        whole, groups = mend(content, *self.template)
        if not groups:
            self.notes.append(f"{name} has no sound Parquet footer (its writer was killed?) and holds no whole episode")
            return None
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mended.parquet"
            path.write_bytes(whole)
            rows = self._rows(name, path)
        if rows is not None:
            self.notes.append(
                f"{name} has no sound Parquet footer (its writer was killed?); it was made again from the pages"
            )
        return rows

    def _rows(self, name: str, path: Path) -> dict[str, np.ndarray] | None:
        """Read a file that has a footer: as a whole, else row group by row group, which is episode by episode."""
        try:
            return Rows.read(self.root, self.features, [path]).columns
        except DatasetInvalid as error:
            reason = str(error).removeprefix(f"{path}")
        groups = list(self._row_groups(path))
        if not groups:
            self.notes.append(f"{name} cannot be read ({reason.strip(' ,').rstrip('.')})")
            return None
        count = pq.read_metadata(path).num_row_groups
        self.notes.append(f"{name} is damaged: {len(groups)} of its {count} row groups can be read")
        return {key: np.concatenate([group[key] for group in groups]) for key in self.features}

    def _row_groups(self, path: Path) -> Iterator[dict[str, np.ndarray]]:
        """Iterate over the row groups that can be read, each through a file of its own."""
        file = pq.ParquetFile(path)
        with tempfile.TemporaryDirectory() as folder:
            alone = Path(folder) / "group.parquet"
            for group in range(file.metadata.num_row_groups):
                try:
                    pq.write_table(file.read_row_group(group), alone)
                    yield Rows.read(self.root, self.features, [alone]).columns
                except (DatasetInvalid, *UNREADABLE):
                    continue


def _template(info: Mapping[str, object], files: Sequence[Path]) -> tuple[bytes, list[int]]:
    """Return a Parquet file of one row with the columns that LeRobot stores, and the values per row of each leaf.

    The columns have the order of a whole file among the dataset's, else that in which the features are described.
    """
    types: dict[str, pa.DataType] = {}
    widths: list[int] = []
    entries = layout.described(info)
    order = _column_order(files)
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


def _column_order(files: Sequence[Path]) -> list[str]:
    """Return the columns of the first whole file, none where there is none."""
    for path in files:
        try:
            return open_parquet(path).schema_arrow.names
        except DatasetInvalid:
            continue
    return []
