"""Parquet: one column a quantity, plain or of lists."""

from pathlib import Path

from pyarrow import parquet

from nas_data.importing.layout import Layout
from nas_data.importing.table import Table, number_or_text

SUFFIXES = (".parquet", ".pq")


def read(path: Path, layout: Layout) -> Table:
    """Read a file; its own key-value metadata are the log's constants."""
    table = parquet.read_table(path)
    metadata = table.schema.metadata or {}
    constants = {key.decode(): number_or_text(value.decode(errors="replace")) for key, value in metadata.items()}
    columns = {name: table.column(name).combine_chunks() for name in table.column_names}
    return Table(path, columns, constants)
