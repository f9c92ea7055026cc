"""PT: a mapping of tensors saved by torch.save, one row per time; scalars and texts are constants."""

import pickle
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

SUFFIXES = (".pt", ".pth")
REMEDY = "save plain tensors: torch.save({'q': q, 't': t}, path)"


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file without executing code in it; other objects than tensors, numbers and texts are refused."""
    import torch

    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError):
        raise LogError(f"{path} is damaged, or holds more than tensors, numbers and texts; {REMEDY}.") from None
    if not isinstance(content, Mapping):
        raise LogError(f"{path} holds a {type(content).__name__}, not tensors by their names; {REMEDY}.")
    columns: dict[str, np.ndarray] = {}
    constants: dict[str, object] = {}
    for name, value in _flatten_mappings(content):
        if isinstance(value, torch.Tensor):
            dense = value.detach().to_dense()
            # types that NumPy lacks, such as bfloat16, have fewer digits than float32
            value = dense.float() if dense.is_floating_point() and dense.element_size() < 4 else dense
        array = np.asarray(value)
        if array.ndim:
            columns[name] = array
        else:
            constants[name] = array.item()
    return LogTable(path, columns, constants)


def _flatten_mappings(content: Mapping[object, object], inside: str = "") -> Iterator[tuple[str, object]]:
    """Yield values by name; values of nested mappings are prefixed with the mapping's name."""
    for key, value in content.items():
        name = f"{inside}.{key}" if inside else str(key)
        if isinstance(value, Mapping):
            yield from _flatten_mappings(value, name)
        elif value is not None:
            yield name, value
