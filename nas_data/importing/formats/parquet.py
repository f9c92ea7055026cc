"""Parquet: one column per quantity, plain or of lists."""

from pathlib import Path

from pyarrow import parquet, types

from nas_data.errors import LogError
from nas_data.importing.layout import LogLayout
from nas_data.importing.table import LogTable, number_or_text, refuse_twice

SUFFIXES = (".parquet", ".pq")
MAGIC = b"PAR1"  # first and last bytes of a Parquet file


def read(path: Path, layout: LogLayout) -> LogTable:
    """Read a file; key-value metadata become constants, struct fields get dotted names."""
    content = path.read_bytes()
    if content.startswith(MAGIC) and not content.endswith(MAGIC):
        raise LogError(f"{path} is cut off: its end is missing; copy it again, or let the recorder close its file.")
    if not content.startswith(MAGIC):
        raise LogError(f"{path} cannot be read as parquet: it is not a Parquet file; give one, or correct 'format'.")
    refuse_twice(path, parquet.read_schema(path).names)
    table = parquet.read_table(path)
    metadata = table.schema.metadata or {}
    constants = {key.decode(): number_or_text(value.decode(errors="replace")) for key, value in metadata.items()}
    while any(types.is_struct(column.type) for column in table.columns):
        table = table.flatten()
    columns = {name: table.column(name).combine_chunks() for name in table.column_names}
    return LogTable(path, columns, constants)
