"""JSON: a list of rows under one key, or one list a column; what stands beside it are constants."""

import json
from pathlib import Path

import pyarrow as pa

from nas_data.errors import LogError, MapError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable

SUFFIXES = (".json",)


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file."""
    content = _parse(path)
    if isinstance(content, list):
        return LogTable(path, _from_rows(path, content))
    if not isinstance(content, dict):
        raise LogError(f"{path} holds a {type(content).__name__}; an object or a list of rows is needed.")
    if layout.entries and layout.entries not in content:
        raise MapError(
            f"{path} has no key '{layout.entries}', under which the map expects the rows; it has: {', '.join(content)}."
        )
    if layout.entries:
        columns = _from_rows(path, content[layout.entries])
        return LogTable(path, columns, {key: value for key, value in content.items() if key != layout.entries})
    lists = {key: value for key, value in content.items() if isinstance(value, list)}
    columns = {key: _column(path, key, value) for key, value in lists.items()}
    return LogTable(path, columns, {key: value for key, value in content.items() if key not in lists})


def _parse(path: Path) -> object:
    """Parse a file; what is wrong with its text is said by line."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise LogError(f"{path} cannot be read as json: it is not in UTF-8; save it in that encoding.") from None
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        # A file that stops early is complained about at its end, or at the start of the text that never closes.
        if error.pos >= len(text.rstrip()) - 1 or error.msg.startswith("Unterminated"):
            raise LogError(
                f"{path} is cut off in line {error.lineno}; copy it again, or let the recorder close its file."
            ) from None
        raise LogError(
            f"{path} cannot be read as json: line {error.lineno}, column {error.colno} is no JSON; repair it there."
        ) from None


def _from_rows(path: Path, rows: object) -> dict[str, pa.Array]:
    """Turn a list of objects into columns; a key that a row lacks is empty there."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise LogError(f'{path} holds no list of objects as rows; each row must be an object like {{"time": 0.0}}.')
    names = list(dict.fromkeys(name for row in rows for name in row))
    return {name: _column(path, name, [row.get(name) for row in rows]) for name in names}


def _column(path: Path, name: str, values: list[object]) -> pa.Array:
    """Return a column; what is no column of one kind becomes text, and is complained about only if it is needed."""
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if value is None else str(value) for value in values])
