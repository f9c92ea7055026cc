"""Rows in which the servos were powered: where the torque was off, a command explains nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid

TORQUE = "nas.torque_enable"


def find_torque_on(dataset: Dataset) -> np.ndarray:
    """Return in which rows every servo was powered, shape (N,); everywhere where the log does not say."""
    if TORQUE not in dataset.columns:
        return np.ones(dataset.n_frames, bool)
    return np.asarray((dataset.columns[TORQUE] >= 1).all(axis=1))


def keep_torque_on(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest stretch with the torque on.

    An arm whose torque is off falls, and what it does afterwards starts from a posture that no command led to: such
    rows belong to no prediction from commands. Episodes keep their numbers; one that was never driven becomes empty.

    Raises:
        DatasetInvalid: no row was driven.
    """
    return select_rows(dataset, find_longest_run)


def keep_torque_on_and_fall(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest stretch with the torque on and what follows it with the torque off.

    How an arm falls is told by its model alone, from wherever it was when it was let go.

    Raises:
        DatasetInvalid: no row was driven.
    """
    return select_rows(dataset, find_run_and_fall)


def count_rows_with_torque(dataset: Dataset) -> np.ndarray:
    """Return how many rows of each episode come before its torque is first switched off, shape (E,)."""
    on = find_torque_on(dataset)
    return np.array([np.append(on[rows], False).argmin() for rows in dataset.episodes()])


def select_rows(dataset: Dataset, keep: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    """Keep some rows of each episode, chosen by where its torque is on, shape (T,)."""
    on = find_torque_on(dataset)
    if on.all():
        return dataset
    if not on.any():
        raise DatasetInvalid(f"The torque is off in every row ({TORQUE} is 0): record with the servos switched on.")
    kept = np.concatenate([keep(on[rows]) for rows in dataset.episodes()])
    ends = np.cumsum(kept)[dataset.starts + dataset.lengths - 1]
    return replace(
        dataset,
        columns={key: column[kept] for key, column in dataset.columns.items()},
        lengths=np.diff(ends, prepend=0),
    )


def find_longest_run(chosen: np.ndarray) -> np.ndarray:
    """Return the longest run of true values as a mask, the first of several; shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    first, after = edges[::2], edges[1::2]
    kept = np.zeros(len(chosen), bool)
    if len(first):
        longest = int(np.argmax(after - first))
        kept[first[longest] : after[longest]] = True
    return kept


def find_run_and_fall(on: np.ndarray) -> np.ndarray:
    """Return the longest run of true values and the false ones right behind it as a mask, shape (T,)."""
    kept = find_longest_run(on)
    if kept.any():
        end = int(np.flatnonzero(kept)[-1]) + 1
        kept[end : end + int(np.append(on[end:], True).argmax())] = True
    return kept
