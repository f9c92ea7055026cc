"""File formats of logs, one module each, with the file suffixes it reads."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeVar, cast

from nas_data import registry
from nas_data.errors import LogError, NasError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

Content = TypeVar("Content")
FORMATS = registry.list_names("importing.formats")


class Format(Protocol):
    """Interface of a format module."""

    SUFFIXES: tuple[str, ...]
    FOLDER: str  # word for a log that is a folder; absent in modules that only read files

    def read(self, path: Path, layout: LogLayout) -> LogTable:
        """Read a file; LogError, ValueError or OSError means that it has another format."""


class Bag(Protocol):
    """Interface of a format module for message logs, with `read_topics` instead of `read`."""

    def read_topics(self, path: Path, layout: LogLayout) -> dict[str, LogTable]:
        """Read the topics of the map, by the keys of its `[topics]`."""


def find_format(name: str) -> Format:
    """Return a format by its name."""
    return cast(Format, registry.import_plugin("importing.formats", name, "format"))


def find_folder_kind(name: str) -> str:
    """Return the word for a log of a format that is a folder; empty if logs are files."""
    return str(getattr(find_format(name), "FOLDER", ""))


def is_folder_log(path: Path, name: str) -> bool:
    """Return whether a folder is one log of a format."""
    return bool(find_folder_kind(name)) and path.is_dir() and bool(getattr(find_format(name), "is_log")(path))  # noqa: B009


def read_tables(path: Path, layout: LogLayout) -> dict[str, LogTable]:
    """Read one log, a file or folder: one table, or one per topic of the map.

    Raises:
        LogError: the file is missing, has another suffix, or cannot be read as this format.
    """
    if layout.topics:
        return _read(path, layout, cast(Bag, find_format(layout.format)).read_topics)
    return {"": read_table(path, layout)}


def read_table(path: Path, layout: LogLayout) -> LogTable:
    """Read one file of a log; raises like `read_tables`."""
    return _read(path, layout, find_format(layout.format).read)


def _read(path: Path, layout: LogLayout, reader: Callable[[Path, LogLayout], Content]) -> Content:
    """Read a file or folder; raise LogError with a remedy if that fails."""
    known = find_format(layout.format)
    folder = is_folder_log(path, layout.format)
    if not folder and find_folder_kind(layout.format) and not (path.is_file() and known.SUFFIXES):
        there = "there is no such folder" if not path.exists() else f"it is not {find_folder_kind(layout.format)}"
        raise LogError(f"{path} cannot be read: {there}; give {find_folder_kind(layout.format)}.")
    if not path.is_file() and not folder:
        raise LogError(f"There is no file {path}; give a recorded log.")
    if not folder and path.suffix.lower() not in known.SUFFIXES:
        raise LogError(
            f"{path} does not end in {' or '.join(known.SUFFIXES)}, but the map says format = '{layout.format}'; "
            "give a log of that format, or another map."
        )
    if not folder and path.stat().st_size == 0:
        raise LogError(f"{path} is empty; give a log with recorded rows.")
    try:
        return reader(path, layout)
    except NasError:
        raise
    except (ValueError, OSError, EOFError, KeyError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
        raise LogError(f"{path} cannot be read as {layout.format}: {reason}.") from None
