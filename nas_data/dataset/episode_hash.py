"""Hash of an episode's values, to find equal episodes in different datasets."""

import hashlib
from collections.abc import Sequence

import numpy as np

from nas_data.dataset.content import stored_column
from nas_data.dataset.dataset import Dataset


def episode_hashes(dataset: Dataset, keys: Sequence[str]) -> list[str]:
    """Return the SHA-256 of each episode's length and exact values of the given features; tasks do not count.

    Args:
        dataset: The episodes.
        keys: Features to hash: all, or those that two datasets share.
    """
    columns = [stored_column(dataset, key) for key in keys]
    little = [np.ascontiguousarray(column.astype(column.dtype.newbyteorder("<"), copy=False)) for column in columns]
    return [_hash(frames, little) for frames in dataset.episodes()]


def _hash(frames: slice, columns: Sequence[np.ndarray]) -> str:
    digest = hashlib.sha256(str(frames.stop - frames.start).encode())
    for column in columns:
        digest.update(column[frames].data)
    return digest.hexdigest()
