"""CSV: one line of column names, then one line per row; a cell holds a number or a JSON list of numbers."""

import codecs
from contextlib import suppress
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from nas_data.count_of import count_of
from nas_data.dataset.rows import TextLines
from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable, refuse_twice

SUFFIXES = (".csv", ".tsv", ".txt")
DELIMITERS = {",": "','", ";": "';'", "\t": "'\\t'"}  # as written in a map
NOT_UTF_8 = "cannot be read as csv: it is not in UTF-8; save it in that encoding."
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file; cells stay text until their column is read, so that no type is guessed from the first rows."""
    _check_start(path, layout.delimiter)
    parsing = csv.ParseOptions(delimiter=layout.delimiter)
    try:
        with csv.open_csv(path, parse_options=parsing) as reader:
            names = reader.schema.names
        refuse_twice(path, [name.strip() for name in names])
        converting = csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True)
        table = csv.read_csv(path, parse_options=parsing, convert_options=converting)
    except pa.ArrowInvalid as error:
        if "UTF8" in str(error):
            raise LogError(f"{path} {NOT_UTF_8}") from None
        _refuse_ragged(path, layout.delimiter)
        raise
    columns = {name.strip(): table.column(i).combine_chunks() for i, name in enumerate(names)}
    return LogTable(path, columns, lines=TextLines(path, len(table)), decimal=layout.decimal)


def _check_start(path: Path, delimiter: str) -> None:
    """Raise LogError for other encodings than UTF-8, or for a header with another delimiter."""
    with path.open("rb") as file:
        line = file.readline()
    try:
        header = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        header = ""
    if line.startswith(UTF_16) or not header or "\0" in header:
        raise LogError(f"{path} {NOT_UTF_8}")
    other = next((sign for sign in DELIMITERS if sign in header), None)
    if delimiter not in header and other is not None:
        raise LogError(
            f"{path} separates its columns by {DELIMITERS[other]}, "
            f"but the map by {DELIMITERS.get(delimiter, repr(delimiter))}; "
            f"set delimiter = {DELIMITERS[other]} at the top of the map."
        )


def _refuse_ragged(path: Path, delimiter: str) -> None:
    """Raise LogError for the row that could not be parsed, with its line and number of cells."""
    bad: list[csv.InvalidRow] = []

    def keep(row: csv.InvalidRow) -> str:
        bad.append(row)
        return "skip"

    # only a single-threaded reader knows line numbers
    parsing = csv.ParseOptions(delimiter=delimiter, invalid_row_handler=keep)
    with suppress(pa.ArrowInvalid):
        csv.read_csv(path, read_options=csv.ReadOptions(use_threads=False), parse_options=parsing)
    if bad and bad[0].actual_columns > bad[0].expected_columns:
        raise LogError(
            f"{path}: line {bad[0].number} has {count_of(bad[0].actual_columns, 'cell')}, but the header, line 1, has "
            f"{bad[0].expected_columns}; remove lines before the header, name every column in it, and write numbers "
            "with a decimal point, or with another delimiter."
        )
    if bad:
        raise LogError(
            f"{path}: line {bad[0].number} has {count_of(bad[0].actual_columns, 'cell')}, "
            f"but the header {bad[0].expected_columns}; the line is damaged or cut off: "
            "repair or remove it."
        )
