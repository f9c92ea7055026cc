"""Checks of a dataset before it is stored or used: valid keys, complete episodes, finite values."""

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.layout import AUTOMATIC, NUMERIC
from nas_data.errors import DatasetInvalid

LARGEST = 1e150  # beyond it the squares in the statistics overflow float64


def check_finite(dataset: Dataset, where: str, drop: str = "drop that episode") -> None:
    """Refuse NaN, infinity, and values that overflow the type in which they are stored.

    Args:
        dataset: The dataset.
        where: Its name in error messages, a path or "the dataset".
        drop: How to drop an episode, for the error message.

    Raises:
        DatasetInvalid: names feature, component, episode and frame of the first such value.
    """
    for key, column in dataset.columns.items():
        if key not in dataset.features or column.dtype.kind != "f":
            continue
        sound = np.abs(column) <= _find_largest_value(column.dtype, np.dtype(dataset.features[key].dtype))
        if sound.all():
            continue
        row, component = (int(index) for index in np.argwhere(~sound)[0])
        episode = int(np.searchsorted(dataset.starts, row, side="right")) - 1
        raise DatasetInvalid(
            f"{where}: the feature '{key}' ({dataset.features[key].names[component]}) is {column[row, component]} "
            f"in episode {episode}, frame {row - int(dataset.starts[episode])}; {drop}, or repair the data that it "
            "was made from."
        )


def _find_largest_value(*types: np.dtype) -> float:
    """Return the largest value that all given types can hold."""
    return min([LARGEST] + [float(np.finfo(dtype).max) for dtype in types if dtype.kind == "f"])


def check_storable(dataset: Dataset, where: str) -> None:
    """Refuse a dataset that LeRobot's tools could not read, extend or merge.

    Raises:
        DatasetInvalid: a feature, episode or rate is invalid; the message says what would be right.
    """
    if not dataset.n_episodes or not (np.asarray(dataset.lengths) > 0).all():
        raise DatasetInvalid(f"{where} holds no episode or an empty one; leave it out, each needs at least one frame.")
    if len(dataset.tasks) != dataset.n_episodes:
        raise DatasetInvalid(
            f"{where} names {count_of(len(dataset.tasks), 'task')} for {count_of(dataset.n_episodes, 'episode')}; give "
            "one for each."
        )
    if not (np.isfinite(dataset.fps) and dataset.fps > 0):
        raise DatasetInvalid(f"{where} has a rate of {dataset.fps} Hz; a positive number is needed.")
    for key, feature in dataset.features.items():
        reason = _find_storage_problem(key, feature.dtype, feature.width)
        if reason:
            raise DatasetInvalid(f"{where}: the feature '{key}' cannot be stored: {reason}.")
    check_finite(dataset, where)


def _find_storage_problem(key: str, dtype: str, width: int) -> str | None:
    if key in AUTOMATIC:
        return "LeRobot fills this column by itself; choose another key"
    if not key or "/" in key:
        return "LeRobot's keys are words without '/'; choose another key"
    if "image" in key:
        return "LeRobot takes keys with 'image' for pictures; choose another key"
    if dtype not in NUMERIC:
        return f"its dtype is '{dtype}'; convert it to numbers or bool"
    return None if width else "it has no components; leave it out"
