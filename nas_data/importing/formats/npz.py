"""NPZ: one NumPy array per quantity, one row per time; arrays without dimensions are constants."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

SUFFIXES = (".npz",)
ZIP = b"PK\x03\x04"  # first bytes of a ZIP archive
OBJECTS = "holds Python objects, which are not read from files; save it as numbers, for example with astype(float)"


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file without unpickling; object arrays are refused if the map uses them."""
    if not zipfile.is_zipfile(path):
        if path.read_bytes()[: len(ZIP)] == ZIP:
            raise LogError(f"{path} is cut off: its last part is missing; copy it again from where it was recorded.")
        raise LogError(f"{path} is not an NPZ archive; write it with numpy.savez.")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: _read_array(archive, name) for name in archive.files}
    except (zipfile.BadZipFile, zlib.error) as error:
        raise LogError(f"{path} is damaged: {error}; restore it from a copy.") from None
    found = {name: array for name, array in arrays.items() if array is not None}
    columns = {name: array for name, array in found.items() if array.ndim}
    scalars = {name: array for name, array in found.items() if not array.ndim}
    # a date in nanoseconds would become a plain integer
    constants = {name: str(array) if array.dtype.kind in "mM" else array.item() for name, array in scalars.items()}
    return LogTable(path, columns, constants, dict.fromkeys(arrays.keys() - found.keys(), OBJECTS))


def _read_array(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray | None:
    """Return an array; None if it would have to be unpickled."""
    try:
        return archive[name]
    except ValueError:
        return None
