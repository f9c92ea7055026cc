"""Selection of rows with servo torque; commands have no effect on rows without.

Rows in which only some servos have torque are left out: simulated servos are switched off together.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nas_data.count_of import count_of, join_items
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.split import format_episodes
from nas_data.errors import DatasetInvalid

TORQUE = "nas.torque_enable"


def find_torque_on(dataset: Dataset) -> np.ndarray:
    """Return the rows in which every servo has torque, shape (N,); all rows without a record."""
    if TORQUE not in dataset.columns:
        return np.ones(dataset.n_frames, bool)
    return np.asarray((dataset.columns[TORQUE] >= 1).all(axis=1))


def find_torque_off(dataset: Dataset) -> np.ndarray:
    """Return the rows in which no servo has torque, shape (N,); no row without a record."""
    if TORQUE not in dataset.columns:
        return np.zeros(dataset.n_frames, bool)
    return np.asarray((dataset.columns[TORQUE] < 1).all(axis=1))


def keep_torque_on(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest run of rows with torque.

    Later rows start from a posture that no command determines, so predictions from commands do not apply. Episodes keep
    their numbers; one without torque becomes empty.

    Raises:
        DatasetInvalid: no row has torque.
    """
    return select_rows(dataset, lambda on, off: find_longest_run(on))


def keep_torque_on_and_fall(dataset: Dataset) -> Dataset:
    """Cut each episode to its longest run of rows with torque and the following rows without any.

    The model predicts the fall of the arm from the state in which the torque is switched off.

    Raises:
        DatasetInvalid: no row has torque.
    """
    return select_rows(dataset, find_run_and_fall)


def drop_rows_without_torque(dataset: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """Return the dataset as of `keep_torque_on` without empty episodes, and a sentence on rows that are left out.

    Raises:
        DatasetInvalid: no row has torque.
    """
    return drop_empty_episodes(dataset, keep_torque_on(dataset))


def follow_shutdowns(dataset: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """Return the dataset as of `keep_torque_on_and_fall` without empty episodes, and sentences on what was done.

    Raises:
        DatasetInvalid: no row has torque.
    """
    kept, left_out = drop_empty_episodes(dataset, keep_torque_on_and_fall(dataset))
    off = int(find_torque_off(kept).sum())
    if not off:
        return kept, left_out
    return kept, (f"The simulated servos are off where the torque is ({TORQUE}): in {count_of(off, 'row')}.", *left_out)


def drop_empty_episodes(dataset: Dataset, kept: Dataset) -> tuple[Dataset, tuple[str, ...]]:
    """Return what was kept of a dataset without empty episodes, and a sentence on rows that are left out."""
    left_out = dataset.n_frames - kept.n_frames
    if not left_out:
        return dataset, ()
    filled = np.flatnonzero(kept.lengths)
    kept = kept if len(filled) == kept.n_episodes else kept.select(filled)
    what = count_of(left_out, "row")
    return kept, (f"Left out, because the torque is or was off ({TORQUE}): {what}.",)


def find_shutdowns(dataset: Dataset) -> np.ndarray | None:
    """Return as `count_rows_with_torque`, shape (E,); None if the torque is never off."""
    counts = count_rows_with_torque(dataset)
    return None if (counts == dataset.lengths).all() else counts


def count_rows_with_torque(dataset: Dataset) -> np.ndarray:
    """Return the number of rows of each episode before its torque is first switched off, shape (E,)."""
    off = find_torque_off(dataset)
    return np.array([np.append(off[rows], True).argmax() for rows in dataset.episodes()])


def select_rows(dataset: Dataset, keep: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Dataset:
    """Keep the rows of each episode that `keep` selects.

    Args:
        dataset: Transitions.
        keep: Returns a mask from the masks of rows with all and without any torque, shape (T,) each.

    Raises:
        DatasetInvalid: no row has torque at all servos.
    """
    on, off = find_torque_on(dataset), find_torque_off(dataset)
    if on.all():
        return dataset
    if not on.any():
        raise DatasetInvalid(describe_lack_of_torque(dataset))
    kept = [keep(on[rows], off[rows]) for rows in dataset.episodes()]
    lengths = np.array([rows.sum() for rows in kept])
    return replace(dataset.take(np.flatnonzero(np.concatenate(kept)), lengths, dataset.tasks), numbers=dataset.numbers)


def describe_lack_of_torque(dataset: Dataset) -> str:
    """Return a sentence on a recording, or episodes of one, without a row in which all servos have torque."""
    off = np.asarray((dataset.columns[TORQUE] < 1).all(axis=0))
    joints = [joint for joint, never in zip(dataset.joints, off, strict=False) if never]
    whose = "The torque" if off.all() else f"The torque of {join_items(joints) or 'some servo'}"
    name = dataset.origin.root if dataset.origin and dataset.origin.root else "the dataset"
    if dataset.numbers:
        where, remedy = f"episode {format_episodes(sorted(dataset.numbers))} of {name}", "give other episodes"
    else:
        where, remedy = str(name), "record with all servos switched on"
    return f"{whose} is off in every row of {where} ({TORQUE}): {remedy}."


def find_longest_run(chosen: np.ndarray) -> np.ndarray:
    """Return a mask of the first longest run of true values, shape (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    first, after = edges[::2], edges[1::2]
    kept = np.zeros(len(chosen), bool)
    if len(first):
        longest = int(np.argmax(after - first))
        kept[first[longest] : after[longest]] = True
    return kept


def find_run_and_fall(on: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return a mask of the longest run of rows with torque and the rows right after it without any, shape (T,)."""
    kept = find_longest_run(on)
    if kept.any():
        end = int(np.flatnonzero(kept)[-1]) + 1
        kept[end : end + int(np.append(off[end:], False).argmin())] = True
    return kept
