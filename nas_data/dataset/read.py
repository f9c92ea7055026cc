"""The bulk reader of LeRobot v3.0 datasets: whole columns through pyarrow, without LeRobot."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.dataset import layout
from nas_data.dataset.checks import check_finite
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME, Feature, make_time_feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.parquet import open_parquet, read_parquet
from nas_data.dataset.passthrough import PassthroughFeatures
from nas_data.dataset.versions import resolve
from nas_data.errors import DatasetInvalid

INDEX = Feature(names=("index",), dtype="int64")
STAMP = Feature(names=("timestamp",), dtype="float64")
STAMP_TOLERANCE = 1e-4  # [s] LeRobot's own tolerance for timestamps


def read(path: Path) -> Dataset:
    """Read a dataset by any writer: nas, LeRobot's API of versions 0.4 to 0.6, `lerobot-record`.

    Images, videos, strings and matrices are passed through. LeRobot's automatic columns are left out. A `timestamp`
    that is not frame_index / fps is a recorder's clock; it becomes `nas.time` if there is none.

    Args:
        path: The dataset's folder, or `datasets/<name>` for its newest version.

    Raises:
        DatasetNotFound: there is no dataset at the path.
        DatasetInvalid: it is unfinished, incomplete, of another format version, or contains NaN.
    """
    root = resolve(path)
    info = DatasetInfo.read(root)
    features = info.vector_features
    rows = Rows.read(root, {**features, "episode_index": INDEX, "task_index": INDEX, "timestamp": STAMP})
    lengths = rows.sort(root)
    _check_totals(root, info, len(rows.columns["episode_index"]), len(lengths))
    numbers, tasks = rows.columns["task_index"][:, 0], read_tasks(root)
    dataset = Dataset(
        features=features,
        columns={key: rows.columns[key] for key in features},
        lengths=lengths,
        fps=info.fps,
        robot_type=info.robot_type or "unknown",
        tasks=find_episode_tasks(tasks, numbers, lengths),
        passthrough=PassthroughFeatures.of(root, int(lengths.sum())),
        frame_tasks=frame_tasks(tasks, numbers, lengths),
    )
    stamps = rows.columns["timestamp"]
    if TIME not in features and contradicts_rate(dataset, stamps):
        dataset = with_clock(dataset, stamps)
    check_finite(dataset, str(root), f"drop that episode ('nas recover {shlex.quote(str(root))} --beyond')")
    return dataset


def contradicts_rate(dataset: Dataset, stamps: np.ndarray) -> bool:
    """Whether LeRobot's time stamps [s], shape (N, 1), differ from frame_index / fps."""
    frame = np.arange(dataset.n_frames) - np.repeat(dataset.starts, dataset.lengths)
    allowed = np.maximum(STAMP_TOLERANCE, np.spacing(np.abs(stamps[:, 0]).astype(np.float32)))
    return bool((np.abs(stamps[:, 0] - frame / dataset.fps) > allowed).any())


def with_clock(dataset: Dataset, stamps: np.ndarray) -> Dataset:
    """Return a dataset with time stamps [s], shape (N, 1), as the recorder's clock."""
    exact = stamps.astype(np.float64)
    return dataset.with_column(
        TIME, make_time_feature(), exact - np.repeat(exact[dataset.starts], dataset.lengths, axis=0)
    )


def read_stamps(root: Path) -> np.ndarray:
    """Return LeRobot's time stamps [s] in the order of the episodes, shape (N, 1)."""
    rows = Rows.read(root, {"episode_index": INDEX, "timestamp": STAMP})
    rows.sort(root)
    return rows.columns["timestamp"]


@dataclass
class Rows:
    """The rows of all data files, in the order of the files.

    Attributes:
        columns: Array of each feature, shape (N, width).
    """

    columns: dict[str, np.ndarray]

    @classmethod
    def read(cls, root: Path, features: Mapping[str, Feature], only: Sequence[Path] = ()) -> "Rows":
        """Read columns of all data files, or of some.

        Raises:
            DatasetInvalid: a file is missing, half-written, or lacks a column.
        """
        paths = list(only) or layout.list_data_files(root)
        if not paths:
            raise DatasetInvalid(f"{root} has no data files (data/*/*.parquet); restore them from a copy.")
        files = [(path, open_parquet(path)) for path in paths]
        count = sum(file.metadata.num_rows for _, file in files)
        columns = {key: np.empty((count, feature.width), feature.dtype) for key, feature in features.items()}
        start = 0
        for path, file in files:
            table = read_parquet(path, list(features), file)
            for key, column in columns.items():
                if key not in table.column_names:
                    raise DatasetInvalid(
                        f"{path} has no column '{key}', which the dataset has; restore it from a copy."
                    )
                _copy(table[key], column[start : start + len(table)], f"{path}, column '{key}'")
            start += len(table)
        return cls(columns)

    def sort(self, root: Path) -> np.ndarray:
        """Sort the rows by episode, and return the length of each episode, shape (E,).

        Raises:
            DatasetInvalid: an episode is missing.
        """
        episode = self.columns["episode_index"][:, 0]
        if (np.diff(episode) < 0).any():
            order = np.argsort(episode, kind="stable")
            self.columns = {key: column[order] for key, column in self.columns.items()}
            episode = episode[order]
        found, lengths = np.unique(episode, return_counts=True)
        if not np.array_equal(found, np.arange(len(found))):
            missing = int(np.flatnonzero(found != np.arange(len(found)))[0])
            raise DatasetInvalid(f"{root} has no rows of episode {missing}; restore its data files from a copy.")
        return lengths.astype(np.int64)


def _copy(column: pa.ChunkedArray, out: np.ndarray, where: str) -> None:
    """Copy an Arrow column of scalars or lists into an array of shape (N, width)."""
    row = 0
    for chunk in filter(len, column.chunks):
        values = _flatten_lists(chunk) if _is_list(chunk.type) else chunk
        if not _is_number(values.type):
            raise DatasetInvalid(
                f"{where} holds {column.type}, not numbers as {layout.INFO} defines; restore it from a copy."
            )
        if chunk.null_count or values.null_count or len(values) != len(chunk) * out.shape[1]:
            raise DatasetInvalid(
                f"{where} holds missing values, or lists of another length than {out.shape[1]}; restore it from a copy."
            )
        out[row : row + len(chunk)] = _view(values).reshape(len(chunk), out.shape[1])
        row += len(chunk)


def _flatten_lists(lists: pa.Array) -> pa.Array:
    """Return the concatenated items of lists; `flatten` would import Arrow's compute functions."""
    if not pa.types.is_fixed_size_list(lists.type):
        return lists.flatten()
    width = lists.type.list_size
    return lists.values.slice(lists.offset * width, len(lists) * width)


def _view(values: pa.Array) -> np.ndarray:
    """Return numbers without nulls as an array; Arrow's own `to_numpy` would import pandas, which takes longer."""
    if pa.types.is_boolean(values.type):
        values = values.cast(pa.uint8())
    dtype = np.dtype(values.type.to_pandas_dtype())
    return np.frombuffer(values.buffers()[1], dtype, count=len(values), offset=values.offset * dtype.itemsize)


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_boolean(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind)


def _is_list(kind: pa.DataType) -> bool:
    return pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind)


def _check_totals(root: Path, info: DatasetInfo, frames: int, episodes: int) -> None:
    """Refuse a dataset whose numbers of rows or episodes differ from its metadata."""
    for what, promised, held in (("frames", info.total_frames, frames), ("episodes", info.total_episodes, episodes)):
        if promised != held:
            raise DatasetInvalid(
                f"{root} is incomplete: {layout.INFO} lists {promised} {what}, the data files contain {held}; rescue "
                "the complete episodes with 'nas recover', or restore the dataset from a copy."
            )


def read_tasks(root: Path) -> dict[int, str]:
    """Read the text of each task; LeRobot 0.4 calls the column `__index_level_0__`, 0.6 `task`.

    Raises:
        DatasetInvalid: the file is damaged.
    """
    path = root / layout.TASKS
    if not path.is_file():
        return {}
    table = read_parquet(path)
    texts = [name for name in table.column_names if name != "task_index"]
    text = next((name for name in ("task", "__index_level_0__") if name in texts), texts[0] if texts else "")
    try:
        columns = [table[name].to_pylist() for name in ("task_index", text)]
        return {int(number): str(task) for number, task in zip(*columns, strict=True)}
    except (KeyError, TypeError, ValueError):  # a missing column, or values of other types
        raise DatasetInvalid(f"{path} has no tasks that can be read; restore it from a copy.") from None


def find_episode_tasks(tasks: Mapping[int, str], task_index: np.ndarray, lengths: np.ndarray) -> tuple[str, ...]:
    """Return the task of each episode; several in one episode are joined in alphabetical order.

    Args:
        tasks: Sentence of each task by its number.
        task_index: Number of each frame's task, shape (N,).
        lengths: Frames of each episode, shape (E,).
    """
    starts = np.cumsum(lengths) - lengths
    first = task_index[starts]
    if np.array_equal(np.repeat(first, lengths), task_index):
        members: Sequence[Sequence[int]] = first[:, None].tolist()
    else:
        members = [np.unique(part).tolist() for part in np.split(task_index, starts[1:])]
    return tuple("; ".join(sorted(tasks.get(number, "") for number in numbers)) for numbers in members)


def frame_tasks(tasks: Mapping[int, str], task_index: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
    """Return each frame's task, shape (N,); None if each episode has one; arguments as for `find_episode_tasks`."""
    if np.array_equal(np.repeat(task_index[np.cumsum(lengths) - lengths], lengths), task_index):
        return None
    return np.array([tasks.get(number, "") for number in task_index.tolist()], object)
