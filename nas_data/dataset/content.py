"""The content hash: it depends on a dataset's content, not on file layout, column order or machine."""

import hashlib
import json

import numpy as np

from nas_data.dataset.dataset import Dataset

SCHEMA = 1  # Bump it when the rule below changes; stored hashes then name another rule, not other data.


def stored_column(dataset: Dataset, key: str) -> np.ndarray:
    """Return a column as it is stored: the feature's dtype, contiguous, shape (N, width)."""
    return np.ascontiguousarray(dataset.columns[key], dtype=dataset.features[key].dtype)


def content_hash(dataset: Dataset) -> str:
    """Return the SHA-256 of a dataset's logical content, as hexadecimal digits.

    Hashed are the features (key, names, units, dtype), the rate, the robot type, each episode's length and
    task, and the exact bits of every value, little-endian, features sorted by key. File layout, column order,
    provenance and LeRobot's automatic columns do not count. Of pass-through features only the description counts.
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
    if dataset.carried:
        described = dataset.carried.features
        header["carried"] = {key: [entry.get("dtype"), entry.get("shape")] for key, entry in described.items()}
    digest = hashlib.sha256(json.dumps(header, sort_keys=True, separators=(",", ":")).encode())
    for key in sorted(dataset.features):
        column = stored_column(dataset, key)
        digest.update(column.astype(column.dtype.newbyteorder("<"), copy=False).data)
    return digest.hexdigest()
