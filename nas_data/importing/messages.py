"""Conversion of a bag's messages to tables, one per topic; names of nested fields are joined with dots."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from nas_data.errors import LogError
from nas_data.importing.table import LogTable

RECEIVED = "log_time"  # time at which the recorder received a message [ns]
NANOSECONDS = 10**9
STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"}, {"secs", "nsecs"})  # fields of a time in ROS 2, Foxglove, ROS 1


def to_tables(path: Path, topics: dict[str, str], messages: Iterable[tuple[str, int, object]]) -> dict[str, LogTable]:
    """Return one table per topic.

    Args:
        path: The bag.
        topics: Table → topic.
        messages: Topic, time of receipt [ns] and content of each message, in order of receipt.

    Raises:
        LogError: a topic has no messages, or messages of several types.
    """
    rows: dict[str, list[dict[str, object]]] = {topic: [] for topic in topics.values()}
    for topic, time, message in messages:
        rows[topic].append({RECEIVED: time, **dict(flatten_fields(message))})
    return {key: _make_table(path, topic, rows[topic]) for key, topic in topics.items()}


def flatten_fields(message: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Yield the fields of a message: times in ns, lists of numbers or texts unchanged, nested fields expanded."""
    values = message if isinstance(message, dict) else _read_attributes(message)
    if values is None:
        yield name, message
        return
    if set(values) in STAMPS:
        seconds, nanoseconds = (int(values[key]) for key in sorted(values, key=len))
        yield name, seconds * NANOSECONDS + nanoseconds
        return
    for key, value in values.items():
        inner = f"{name}.{key}" if name else key
        if isinstance(value, list | tuple) and value and (isinstance(value[0], dict) or _read_attributes(value[0])):
            for number, item in enumerate(value):
                yield from flatten_fields(item, f"{inner}.{number}")
        else:
            yield from flatten_fields(value, inner)


def _read_attributes(value: object) -> dict | None:
    """Return the fields of a message object; None for a plain value."""
    if isinstance(value, str | bytes | int | float | bool | np.ndarray | np.generic | list | tuple) or value is None:
        return None
    slots = getattr(value, "__slots__", None) or getattr(value, "__dict__", {})
    return {key: getattr(value, key) for key in slots if not key.startswith("_") and key != "__msgtype__"} or None


def _make_table(path: Path, topic: str, rows: list[dict[str, object]]) -> LogTable:
    """Convert the messages of a topic to columns; a field that a message lacks is an empty cell."""
    if not rows:
        raise LogError(f"{path} has no messages of '{topic}'; give the bag that has, or correct [topics] of the map.")
    return LogTable(Path(f"{path}:{topic}"), make_columns(rows))


def make_columns(rows: Sequence[Mapping[str, object]]) -> dict[str, pa.Array]:
    """Return rows of fields as columns; missing fields become empty cells."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: make_column([row.get(name) for row in rows]) for name in names}


def make_column(values: list[object]) -> pa.Array:
    """Return values as a column; those of mixed types become text, which is an error only if the column is read."""
    plain = [value.tolist() if isinstance(value, np.ndarray) else value for value in values]
    try:
        return pa.array(plain)
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError, UnicodeEncodeError):
        texts = [None if value is None else str(value).encode(errors="replace").decode() for value in plain]
        return pa.array(texts)
