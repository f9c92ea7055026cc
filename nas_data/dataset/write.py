"""The bulk writer of LeRobot v3.0 datasets: whole columns through pyarrow instead of frame by frame."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from nas_data.dataset import layout
from nas_data.dataset.card import render_card
from nas_data.dataset.checks import check_storable
from nas_data.dataset.content import convert_column, hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.staging import publish, refuse_existing, staging_folder, write_synced
from nas_data.dataset.statistics import Statistics, combine_statistics, compute_statistics
from nas_data.dataset.videos import VIDEO, VIDEO_PATH, place_videos
from nas_data.typed_json import as_object


def write(dataset: Dataset, root: Path, provenance: Provenance, attachments: Mapping[str, bytes] | None = None) -> Path:
    """Write a dataset into a new folder, atomically.

    Args:
        dataset: The dataset.
        root: The folder; must not exist.
        provenance: Origin of the dataset; content hash and file hashes are filled in.
        attachments: Further files by their path in the dataset, for example `meta/source.xml`.

    Returns:
        `root`.

    Raises:
        OutputExists: the folder exists.
        DatasetInvalid: LeRobot's tools could not read this dataset, or a value is NaN or infinite.
    """
    refuse_existing(root)
    check_storable(dataset, "The dataset to be written")
    complete = replace(provenance, content_hash=hash_content(dataset))
    with staging_folder(root) as hidden:
        fill(hidden, dataset, complete, attachments or {})
        publish(hidden, root)
    return root


def fill(folder: Path, dataset: Dataset, provenance: Provenance, attachments: Mapping[str, bytes]) -> None:
    """Write every file of a dataset that passed `check_storable` into a folder."""
    hashes: dict[str, Future[str]] = {}
    passthrough = dataset.passthrough
    clips = passthrough.clips(dataset.starts, dataset.lengths, dataset.fps) if passthrough else {}
    places, videos = place_videos(folder, clips)
    with ThreadPoolExecutor(max_workers=1) as disk:
        hashes |= {name: disk.submit(_hash, path) for name, path in videos.items()}
        for name, content in _make_files(dataset, attachments, places):
            # A file is written while the next one is built: at most two are in memory.
            for earlier in hashes.values():
                earlier.result()
            hashes[name] = disk.submit(_write_hashed, folder / name, content)
    complete = replace(provenance, files={name: found.result() for name, found in hashes.items()})
    write_synced(folder / layout.PROVENANCE, encode_json(complete.to_json()))
    write_synced(folder / layout.CARD, render_card(dataset, complete).encode())


def _hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _write_hashed(path: Path, content: bytes | memoryview) -> str:
    """Write a file and return its SHA-256."""
    write_synced(path, content)
    return hashlib.sha256(content).hexdigest()


def _make_files(
    dataset: Dataset, attachments: Mapping[str, bytes], places: Mapping[str, list[object]]
) -> Iterator[tuple[str, bytes | memoryview]]:
    """Yield path and content of each file except videos, card and provenance; `places` locates the videos."""
    tasks = dataset.all_tasks
    columns = {key: convert_column(dataset, key) for key in dataset.features}
    columns |= make_automatic_columns(dataset, tasks)
    # Metadata come first, so that the files of a killed writer can be recovered.
    yield layout.INFO, encode_json(as_object(make_info(dataset, len(tasks))))
    yield layout.TASKS, encode_parquet(_make_task_table(tasks))
    row_bytes = sum(column.itemsize * column.shape[1] for column in columns.values())
    passthrough = dataset.passthrough
    files = split_episodes(dataset.lengths, row_bytes + (passthrough.row_bytes if passthrough else 0))
    # NumPy sorts and Arrow encodes without the GIL, so both run in parallel.
    with ThreadPoolExecutor(max_workers=1) as beside:
        statistics_later = beside.submit(compute_statistics, columns, dataset.lengths)
        for number, episodes in enumerate(files):
            yield layout.make_numbered_path(layout.DATA_TEMPLATE, number), make_data_file(columns, dataset, episodes)
        found = statistics_later.result()
    table = make_episode_table(dataset, files, found)
    table = pa.table({**{key: table[key] for key in table.column_names}, **{k: pa.array(v) for k, v in places.items()}})
    seen = passthrough.statistics(dataset.starts) if passthrough else []
    for key in dict.fromkeys(key for entry in seen for key in entry):
        table = table.append_column(key, pa.array([entry.get(key) for entry in seen]))
    for number, rows in enumerate(split_episodes(np.ones(len(table)), int(table.nbytes / len(table)) + 1)):
        part = table.slice(rows.start, rows.stop - rows.start)
        here = {"meta/episodes/chunk_index": number // layout.FILES_PER_CHUNK}
        here["meta/episodes/file_index"] = number % layout.FILES_PER_CHUNK
        for key, value in here.items():
            part = part.append_column(key, make_number_array(np.full(len(part), value, np.int64)))
        yield layout.make_numbered_path(layout.EPISODES_TEMPLATE, number), encode_parquet(part)
    overall = {key: {name: values.tolist() for name, values in entry.overall.items()} for key, entry in found.items()}
    yield layout.STATS, encode_json({**overall, **combine_statistics(seen)})
    yield from attachments.items()


def make_automatic_columns(dataset: Dataset, tasks: list[str]) -> dict[str, np.ndarray]:
    """Return the columns that LeRobot adds to every dataset, shape (N, 1) each."""
    lengths = np.asarray(dataset.lengths, np.int64)
    index = np.arange(dataset.n_frames)
    frame = index - np.repeat(dataset.starts, lengths)
    task_index = {task: number for number, task in enumerate(tasks)}
    if dataset.frame_tasks is None:
        numbers_of_tasks = np.repeat([task_index[task] for task in dataset.tasks], lengths)
    else:
        numbers_of_tasks = np.array([task_index[task] for task in dataset.frame_tasks.tolist()])
    columns = {
        "timestamp": frame / dataset.fps,
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
        "index": index,
        "task_index": numbers_of_tasks,
    }
    return {key: column.astype(layout.AUTOMATIC[key])[:, None] for key, column in columns.items()}


def split_episodes(lengths: np.ndarray, row_bytes: int) -> list[range]:
    """Divide episodes into files of at most 100 MB, at least one episode each."""
    limit = layout.FILE_MEGABYTES * 2**20 / row_bytes
    files, start, rows = [], 0, 0.0
    for episode, length in enumerate(np.asarray(lengths).tolist()):
        if episode > start and rows + length > limit:
            files.append(range(start, episode))
            start, rows = episode, 0.0
        rows += length
    return [*files, range(start, len(lengths))]


def make_data_file(columns: Mapping[str, np.ndarray], dataset: Dataset, episodes: range) -> memoryview:
    """Return a Parquet file of some episodes, one row group per episode as in LeRobot."""
    lengths, passthrough = dataset.lengths, dataset.passthrough
    first, last = int(lengths[: episodes.start].sum()), int(lengths[: episodes.stop].sum())
    arrays = {key: _convert_to_arrow(column[first:last]) for key, column in columns.items()}
    further = passthrough.columns(first, lengths[episodes.start : episodes.stop], dataset.fps) if passthrough else {}
    metadata = _make_huggingface_metadata(columns, passthrough.huggingface() if passthrough else {})
    table = pa.table({**arrays, **further}).replace_schema_metadata(metadata)
    stream = pa.BufferOutputStream()
    # Dictionaries make files of floats larger and twice as slow, but files of messages that every frame repeats ten
    # times smaller. LeRobot filters episodes by episode_index only.
    repeated: list[str] | bool = [path for key in further for path in _find_texts(table.schema.field(key).type, key)]
    options = {"use_dictionary": repeated or False, "write_statistics": ["episode_index"]}
    with pq.ParquetWriter(stream, table.schema, **options) as writer:
        sizes = lengths[episodes.start : episodes.stop]
        breaks = [0, *(np.flatnonzero(np.diff(sizes)) + 1).tolist(), len(sizes)]
        row = 0
        for start, stop in pairwise(breaks):
            rows = int(sizes[start:stop].sum())
            writer.write_table(table.slice(row, rows), row_group_size=int(sizes[start]))
            row += rows
    return memoryview(stream.getvalue())


def _find_texts(kind: pa.DataType, path: str) -> Iterator[str]:
    """Yield the path of each text in a column."""
    if isinstance(kind, pa.BaseExtensionType):
        yield from _find_texts(kind.storage_type, path)
    elif pa.types.is_list(kind):
        yield from _find_texts(kind.value_type, f"{path}.list.element")
    elif pa.types.is_struct(kind):
        for field in kind:
            yield from _find_texts(field.type, f"{path}.{field.name}")
    elif pa.types.is_string(kind):
        yield path


def _convert_to_arrow(column: np.ndarray) -> pa.Array:
    """Return a column as LeRobot stores it: a scalar where the width is 1, else a list of fixed size."""
    flat = make_number_array(column.reshape(-1))
    return flat if column.shape[1] == 1 else pa.FixedSizeListArray.from_arrays(flat, column.shape[1])


def _make_huggingface_metadata(columns: Mapping[str, np.ndarray], further: Mapping[str, object]) -> dict[str, str]:
    """Return the schema metadata of `datasets.Features`, with the given metadata of further columns."""
    entries: dict[str, object] = {}
    for key, column in columns.items():
        value = {"dtype": str(column.dtype), "_type": "Value"}
        entries[key] = value if column.shape[1] == 1 else {"feature": value, "length": column.shape[1], "_type": "List"}
    return {"huggingface": json.dumps({"info": {"features": {**entries, **further}}})}


def make_episode_table(dataset: Dataset, files: list[range], found: Mapping[str, Statistics]) -> pa.Table:
    """Return the table of `meta/episodes`: location and statistics of each episode."""
    lengths = np.asarray(dataset.lengths, np.int64)
    number = np.repeat(np.arange(len(files)), [len(episodes) for episodes in files])
    tasks = dataset.episode_tasks
    columns: dict[str, pa.Array] = {
        "episode_index": make_number_array(np.arange(len(lengths))),
        "tasks": make_list_array(
            make_text_array([task for found in tasks for task in found]), [len(found) for found in tasks]
        ),
        "length": make_number_array(lengths),
        "data/chunk_index": make_number_array(number // layout.FILES_PER_CHUNK),
        "data/file_index": make_number_array(number % layout.FILES_PER_CHUNK),
        "dataset_from_index": make_number_array(dataset.starts),
        "dataset_to_index": make_number_array(dataset.starts + lengths),
    }
    for key, entry in found.items():
        for name, values in entry.episodes.items():
            widths = np.full(len(lengths), values.shape[1])
            columns[f"stats/{key}/{name}"] = make_list_array(make_number_array(values.reshape(-1)), widths)
    return pa.table(columns)


def _make_task_table(tasks: list[str]) -> pa.Table:
    """Return the table of tasks with the pandas index that both LeRobot versions look tasks up in."""
    table = pa.table({"task_index": make_number_array(np.arange(len(tasks))), "task": make_text_array(tasks)})
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
        for name, (kind, numpy) in kinds.items()
    ]
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def make_info(dataset: Dataset, n_tasks: int) -> DatasetInfo:
    """Return `meta/info.json` as both LeRobot versions write it."""
    passthrough = dataset.passthrough
    further = passthrough.features if passthrough else {}
    automatic = {key: {"dtype": dtype, "shape": [1], "names": None} for key, dtype in layout.AUTOMATIC.items()}
    return DatasetInfo(
        robot_type=dataset.robot_type,
        total_episodes=dataset.n_episodes,
        total_frames=dataset.n_frames,
        total_tasks=n_tasks,
        fps=int(dataset.fps) if float(dataset.fps).is_integer() else float(dataset.fps),
        splits={"train": f"0:{dataset.n_episodes}"},
        video_path=VIDEO_PATH if any(entry.get("dtype") == VIDEO for entry in further.values()) else None,
        features={**{key: feature.to_info() for key, feature in dataset.features.items()}, **further, **automatic},
        tools=tuple(passthrough.tools) or None if passthrough else None,
    )


def encode_parquet(table: pa.Table) -> memoryview:
    """Return a table as a Parquet file."""
    stream = pa.BufferOutputStream()
    pq.write_table(table, stream, use_dictionary=False)
    return memoryview(stream.getvalue())


def encode_json(content: Mapping[str, object]) -> bytes:
    """Return an object as a JSON file."""
    return json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False).encode()


def make_number_array(values: np.ndarray) -> pa.Array:
    """Return numbers or booleans, shape (N,), as an Arrow array; numbers are not copied.

    `pyarrow.array` would first import pandas, which takes longer than the rest.
    """
    values = np.ascontiguousarray(values)
    stored = np.packbits(values, bitorder="little") if values.dtype == bool else values
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(stored)])


def make_text_array(values: Sequence[str]) -> pa.StringArray:
    """Return texts as an Arrow array."""
    encoded = [value.encode() for value in values]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(encoded), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))


def make_list_array(values: pa.Array, lengths: Sequence[int] | np.ndarray) -> pa.ListArray:
    """Return consecutive values as an array of lists with the given lengths."""
    offsets = np.cumsum([0, *lengths], dtype=np.int32)
    return pa.ListArray.from_arrays(make_number_array(offsets), values)
