"""JSON: a list of rows (also under a key, or one per line), or one list per column; other keys are constants."""

import json
from pathlib import Path

import pyarrow as pa

from nas_data.errors import LogError, MapError
from nas_data.importing.layout import LogLayout
from nas_data.importing.messages import flatten_fields, make_column, make_columns
from nas_data.importing.table import LogTable

SUFFIXES = (".json", ".jsonl", ".ndjson")


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file."""
    content = _parse(path)
    if isinstance(content, list):
        return LogTable(path, _from_rows(path, content))
    if not isinstance(content, dict):
        raise LogError(f"{path} holds a {type(content).__name__}; write an object of columns, or a list of rows.")
    if layout.entries and layout.entries not in content:
        raise MapError(
            f"{path} has no key '{layout.entries}', under which the map expects the rows; it has: {', '.join(content)}."
        )
    if layout.entries:
        columns = _from_rows(path, content[layout.entries])
        return LogTable(path, columns, {key: value for key, value in content.items() if key != layout.entries})
    lists = {key: value for key, value in content.items() if isinstance(value, list)}
    columns = {key: make_column(value) for key, value in lists.items()}
    return LogTable(path, columns, {key: value for key, value in content.items() if key not in lists})


def _parse(path: Path) -> object:
    """Parse a file; raise LogError with the line if it is not UTF-8 or not JSON."""
    try:
        text = path.read_text(encoding="utf-8-sig").rstrip()
    except UnicodeDecodeError:
        raise LogError(f"{path} cannot be read as json: it is not in UTF-8; save it in that encoding.") from None
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        first = error
    if (first.msg, first.lineno, first.colno) == ("Extra data", 2, 1):  # one value per line
        text = "[" + ",\n".join(line for line in text.split("\n") if line.strip()) + "]"
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        # The error of a truncated file is at its end, or at the start of an unterminated string.
        if error.pos >= len(text) - 1 or error.msg.startswith("Unterminated"):
            raise LogError(
                f"{path} is cut off in line {error.lineno}; copy it again, or let the recorder close its file."
            ) from None
        raise LogError(
            f"{path} cannot be read as json: line {error.lineno}, column {error.colno} is not valid JSON; repair it "
            "there."
        ) from None


def _from_rows(path: Path, rows: object) -> dict[str, pa.Array]:
    """Convert a list of objects to columns; nested names are joined with dots, missing keys are empty cells."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise LogError(f'{path} holds no list of objects as rows; each row must be an object like {{"time": 0.0}}.')
    return make_columns([dict(flatten_fields(row)) for row in rows])
