"""Arrow arrays made of NumPy arrays and texts; `pyarrow.array` would first import pandas, which takes longer."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa


def numbers(values: np.ndarray) -> pa.Array:
    """Return numbers or booleans, shape (N,), as an Arrow array; numbers are not copied."""
    values = np.ascontiguousarray(values)
    stored = np.packbits(values, bitorder="little") if values.dtype == bool else values
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(stored)])


def texts(values: Sequence[str]) -> pa.StringArray:
    """Return texts as an Arrow array."""
    encoded = [value.encode() for value in values]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(len(encoded), pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded)))


def lists(values: pa.Array, lengths: Sequence[int] | np.ndarray) -> pa.ListArray:
    """Return consecutive values as an array of lists with the given lengths."""
    offsets = np.cumsum([0, *lengths], dtype=np.int32)
    return pa.ListArray.from_arrays(numbers(offsets), values)
