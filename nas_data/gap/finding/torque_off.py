"""Selection of rows with servo torque; commands have no effect on rows without."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.errors import DatasetInvalid

TORQUE = "nas.torque_enable"


def find_torque_on(dataset: Dataset) -> np.ndarray:
    """Return the rows in which every servo has torque, shape (N,); all rows without a record."""
    if TORQUE not in dataset.columns:
        return np.ones(dataset.n_frames, bool)
    return np.asarray((dataset.columns[TORQUE] >= 1).all(axis=1))


def keep_torque_on(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest run of rows with torque.

    Later rows start from a posture that no command determines, so predictions from commands do not apply. Episodes keep
    their numbers; one without torque becomes empty.

    Raises:
        DatasetInvalid: no row has torque.
    """
    return select_rows(dataset, find_longest_run)


def keep_torque_on_and_fall(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest run of rows with torque and the following rows without.

    The model predicts the fall of the arm from the state in which the torque is switched off.

    Raises:
        DatasetInvalid: no row has torque.
    """
    return select_rows(dataset, find_run_and_fall)


def count_rows_with_torque(dataset: Dataset) -> np.ndarray:
    """Return the number of rows of each episode before its torque is first switched off, shape (E,)."""
    on = find_torque_on(dataset)
    return np.array([np.append(on[rows], False).argmin() for rows in dataset.episodes()])


def select_rows(dataset: Dataset, keep: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    """Keep the rows of each episode that `keep` selects from its torque mask, shape (T,)."""
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
    """Return a mask of the first longest run of true values, shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    first, after = edges[::2], edges[1::2]
    kept = np.zeros(len(chosen), bool)
    if len(first):
        longest = int(np.argmax(after - first))
        kept[first[longest] : after[longest]] = True
    return kept


def find_run_and_fall(on: np.ndarray) -> np.ndarray:
    """Return a mask of the longest run of true values and the false ones right after it, shape (T,)."""
    kept = find_longest_run(on)
    if kept.any():
        end = int(np.flatnonzero(kept)[-1]) + 1
        kept[end : end + int(np.append(on[end:], True).argmax())] = True
    return kept
