"""MAT: arrays of a MATLAB file, one row per time; struct fields have dotted names, scalars are constants."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

SUFFIXES = (".mat",)


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file without executing code in it."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path, struct_as_record=True, chars_as_strings=True)
    except NotImplementedError:
        raise LogError(f"{path} is of MATLAB's format 7.3; load it there, and save it with save(…, '-v7').") from None
    except (MatReadError, ValueError, TypeError, IndexError) as error:
        raise LogError(f"{path} cannot be read as mat ({error}); save it again with save(…, '-v7').") from None
    columns: dict[str, np.ndarray] = {}
    constants: dict[str, object] = {}
    for name, value in _flatten_structs({key: value for key, value in content.items() if not key.startswith("__")}):
        if value.dtype.kind in "US" and value.size == 1:
            constants[name] = str(value.item())
        elif value.size == 1:
            constants[name] = value.item()
        else:
            columns[name] = value.ravel() if value.ndim == 2 and 1 in value.shape else value
    return LogTable(path, columns, constants)


def _flatten_structs(variables: dict[str, np.ndarray], inside: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield numeric and text arrays by name; fields of structs are prefixed with the struct's name."""
    for key, value in variables.items():
        name = f"{inside}.{key}" if inside else key
        if value.dtype.names and value.size == 1:
            record = value.ravel()[0]
            yield from _flatten_structs({field: np.asarray(record[field]) for field in value.dtype.names}, name)
        elif value.dtype == object and all(np.asarray(cell).dtype.kind in "US" for cell in value.ravel()):
            yield name, np.array(["".join(map(str, np.ravel(cell))) for cell in value.ravel()])
        elif value.dtype.kind in "biufUS":
            yield name, value
