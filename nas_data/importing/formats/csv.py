"""CSV: one line of column names, then one line a row; a cell holds a number or a JSON list of numbers."""

from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from nas_data.importing.layout import Layout
from nas_data.importing.table import Table

SUFFIXES = (".csv", ".tsv", ".txt")


def read(path: Path, layout: Layout) -> Table:
    """Read a file; a cell stays text until its column is asked for, so that no type is guessed from the first rows."""
    parsing = csv.ParseOptions(delimiter=layout.delimiter)
    with csv.open_csv(path, parse_options=parsing) as reader:
        names = reader.schema.names
    converting = csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True)
    table = csv.read_csv(path, parse_options=parsing, convert_options=converting)
    return Table(path, {name.strip(): table.column(i).combine_chunks() for i, name in enumerate(names)})
