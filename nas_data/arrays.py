"""The type of an array in signatures that a strict type checker reads; docstrings say shape and unit."""

from typing import Any, TypeAlias

import numpy.typing as npt

Array: TypeAlias = npt.NDArray[Any]
