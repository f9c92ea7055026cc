"""Datasets with some values of a column changed, because their own arrays are read-only."""

from typing import Any

import numpy as np

from nas_data.dataset.dataset import Dataset


def set_values(dataset: Dataset, key: str, where: Any, values: np.ndarray | float) -> Dataset:
    """Return a dataset with the values of a column at an index replaced."""
    column = dataset.columns[key].copy()
    column[where] = values
    return dataset.with_column(key, dataset.features[key], column)
