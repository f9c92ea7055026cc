"""The array type for signatures, whose shape and unit docstrings state, and evenly spaced indices."""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[Any]


def thin_evenly(count: int, wanted: int) -> np.ndarray:
    """Return evenly spaced indices below `count`, about `wanted` but at least two, shape (k,)."""
    return np.unique(np.linspace(0, count - 1, min(count, max(2, wanted))).round().astype(int))
