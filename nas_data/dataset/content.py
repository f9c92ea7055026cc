"""Hashes of a dataset's content and of each episode; file layout, column order and machine do not count."""

import hashlib
import json
from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset

SCHEMA = 1  # increase it if the rule below changes, so that stored hashes are not compared with those of another rule


def convert_column(dataset: Dataset, key: str) -> np.ndarray:
    """Return a column as it is stored: the feature's dtype, contiguous, shape (N, width)."""
    return np.ascontiguousarray(dataset.columns[key], dtype=dataset.features[key].dtype)


def convert_to_little_endian(dataset: Dataset, key: str) -> np.ndarray:
    """Return a column as it is stored, little-endian on every machine."""
    column = convert_column(dataset, key)
    return np.ascontiguousarray(column.astype(column.dtype.newbyteorder("<"), copy=False))


def choose_content_hash(dataset: Dataset, stored: str) -> str:
    """Return the stored hash of a dataset if it is valid, else compute it.

    Those of earlier versions are valid, too, although they do not cover the tasks of frames.

    Args:
        dataset: The dataset.
        stored: The hash in its provenance; empty if there is none.
    """
    digest = hash_content(dataset)
    if dataset.frame_tasks is None or digest == stored:
        return digest
    return stored if hash_content(dataset, frame_tasks=False) == stored else digest


def has_content_hash(dataset: Dataset, stored: str) -> bool:
    """Whether a stored hash is valid; see `choose_content_hash`."""
    return choose_content_hash(dataset, stored) == stored


def hash_content(dataset: Dataset, frame_tasks: bool = True) -> str:
    """Return the SHA-256 of a dataset's logical content, as hexadecimal digits.

    The hash covers the features (key, names, units, dtype) sorted by key, the rate, the robot type, and each episode's
    length, tasks and exact values, little-endian. It ignores file layout, column order, provenance and LeRobot's
    automatic columns. Of pass-through features it covers only the description.

    Args:
        dataset: The dataset.
        frame_tasks: Whether it covers in which frames the task changes.
    """
    header: dict[str, object] = {
        "schema": SCHEMA,
        "fps": float(dataset.fps).hex(),
        "robot_type": dataset.robot_type,
        "lengths": [int(length) for length in dataset.lengths],
        "tasks": list(dataset.tasks),
        "features": {
            key: {"names": feature.names, "units": feature.units, "dtype": feature.dtype}
            for key, feature in dataset.features.items()
        },
    }
    if dataset.passthrough and dataset.passthrough.features:
        described = dataset.passthrough.features
        header["carried"] = {key: [entry.get("dtype"), entry.get("shape")] for key, entry in described.items()}
    if frame_tasks and dataset.frame_tasks is not None:
        header["task_spans"] = _list_task_spans(dataset.frame_tasks)
    digest = hashlib.sha256(json.dumps(header, sort_keys=True, separators=(",", ":")).encode())
    for key in sorted(dataset.features):
        digest.update(convert_to_little_endian(dataset, key).data)
    return digest.hexdigest()


def _list_task_spans(frame_tasks: np.ndarray) -> list[tuple[int, str]]:
    """Return the frames at which another task begins, with that task; few even in long recordings."""
    begins = np.concatenate([[True], frame_tasks[1:] != frame_tasks[:-1]])[: len(frame_tasks)]
    return [(start, str(frame_tasks[start])) for start in np.flatnonzero(begins).tolist()]


def hash_episodes(dataset: Dataset, keys: Sequence[str]) -> list[str]:
    """Return the SHA-256 of each episode's length and exact values of the given features; tasks do not count.

    Args:
        dataset: The episodes.
        keys: Features to hash: all, or those that two datasets share.
    """
    columns, hashes = [convert_to_little_endian(dataset, key) for key in keys], []
    for frames in dataset.episodes():
        digest = hashlib.sha256(str(frames.stop - frames.start).encode())
        for column in columns:
            digest.update(column[frames].data)
        hashes.append(digest.hexdigest())
    return hashes
