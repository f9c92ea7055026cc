"""File formats of logs: each file of the folder reads one and says which endings its files have."""

from pathlib import Path
from typing import Protocol, cast

from nas_data import registry
from nas_data.errors import LogError, NasError
from nas_data.importing.layout import Layout
from nas_data.importing.table import Table

FORMATS = registry.names("importing.formats")


class Format(Protocol):
    """What a file of this folder defines."""

    SUFFIXES: tuple[str, ...]

    def read(self, path: Path, layout: Layout) -> Table:
        """Read a file; any of `LogError`, `ValueError`, `OSError` says that it is none of this format."""


def find_format(name: str) -> Format:
    """Return a format by its name."""
    return cast(Format, registry.module("importing.formats", name, "format"))


def read_table(path: Path, layout: Layout) -> Table:
    """Read one file of a log.

    Raises:
        LogError: no such file, another ending than the format's, or content that cannot be read as it.
    """
    known = find_format(layout.format)
    if not path.is_file():
        raise LogError(f"There is no file {path}; give a recorded log.")
    if path.suffix.lower() not in known.SUFFIXES:
        raise LogError(
            f"{path} does not end in {' or '.join(known.SUFFIXES)}, but the map says format = '{layout.format}'; "
            "give the log that belongs to the map, or another map."
        )
    if path.stat().st_size == 0:
        raise LogError(f"{path} is empty; give a log with recorded rows.")
    try:
        return known.read(path, layout)
    except NasError:
        raise
    except (ValueError, OSError, EOFError, KeyError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
        raise LogError(f"{path} cannot be read as {layout.format}: {reason}.") from None
