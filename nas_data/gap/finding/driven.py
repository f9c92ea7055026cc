"""Rows in which the servos were powered: where the torque was off, a command explains nothing."""

from dataclasses import replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid

TORQUE = "nas.torque_enable"


def torque_on(dataset: Dataset) -> np.ndarray:
    """Return in which rows every servo was powered, shape (N,); everywhere where the log does not say."""
    if TORQUE not in dataset.columns:
        return np.ones(dataset.n_frames, bool)
    return np.asarray((dataset.columns[TORQUE] >= 1).all(axis=1))


def while_driven(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest stretch with the torque on.

    An arm whose torque is off falls, and what it does afterwards starts from a posture that no command led to: such
    rows belong to no prediction from commands. Episodes keep their numbers; one that was never driven becomes empty.

    Raises:
        DatasetInvalid: no row was driven.
    """
    on = torque_on(dataset)
    if on.all():
        return dataset
    if not on.any():
        raise DatasetInvalid(f"The torque is off in every row ({TORQUE} is 0): record with the servos switched on.")
    kept = np.concatenate([longest_run(on[rows]) for rows in dataset.episodes()])
    ends = np.cumsum(kept)[dataset.starts + dataset.lengths - 1]
    return replace(
        dataset,
        columns={key: column[kept] for key, column in dataset.columns.items()},
        lengths=np.diff(ends, prepend=0),
    )


def longest_run(chosen: np.ndarray) -> np.ndarray:
    """Return the longest run of true values as a mask, the first of several; shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    first, after = edges[::2], edges[1::2]
    kept = np.zeros(len(chosen), bool)
    if len(first):
        longest = int(np.argmax(after - first))
        kept[first[longest] : after[longest]] = True
    return kept
