"""Reading of Parquet files; damaged ones are refused."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from nas_data.errors import DatasetInvalid

UNREADABLE = (pa.ArrowException, OSError, UnicodeDecodeError)  # exceptions of Arrow for damaged files


def open_parquet(path: Path) -> pq.ParquetFile:
    """Open a Parquet file without copying it into memory.

    Raises:
        DatasetInvalid: it is unfinished, or no Parquet file.
    """
    try:
        file = pq.ParquetFile(path, memory_map=True)
    except UNREADABLE:
        raise DatasetInvalid(
            f"{path} is only half-written (it has no Parquet footer: its writer was killed); "
            "rescue the other episodes with 'nas recover', or restore the file from a copy."
        ) from None
    check_footer(file, path)
    return file


def check_footer(file: pq.ParquetFile, path: Path) -> None:
    """Refuse a footer with damaged row counts or column names, which Arrow does not detect.

    Raises:
        DatasetInvalid: the footer is damaged.
    """
    metadata = file.metadata
    rows = sum(metadata.row_group(group).num_rows for group in range(metadata.num_row_groups))
    try:
        sound = bool(file.schema_arrow.names) and rows == metadata.num_rows
    except UNREADABLE:
        sound = False
    if not sound:
        raise DatasetInvalid(f"{path} has a damaged Parquet footer; rescue its rows with 'nas recover'.")


def read_parquet(path: Path, columns: Sequence[str] | None = None, file: pq.ParquetFile | None = None) -> pa.Table:
    """Read a Parquet file, or some of its columns.

    Args:
        path: The file.
        columns: Columns to read; missing ones are skipped; all by default.
        file: The open file, if it is open already.

    Raises:
        DatasetInvalid: it is half-written or damaged.
    """
    file = file or open_parquet(path)
    try:
        table = file.read(columns=None if columns is None else list(columns))
    except UNREADABLE as error:
        reason = " ".join(str(error).split())
        raise DatasetInvalid(f"{path} is damaged ({reason}); restore it from a copy.") from None
    if len(table) != file.metadata.num_rows:
        raise DatasetInvalid(f"{path} is damaged (rows are missing); restore it from a copy.")
    return table


def try_parquet(path: Path, columns: Sequence[str] | None = None) -> pa.Table | None:
    """Read a Parquet file, or some of its columns; None if it is damaged."""
    try:
        return read_parquet(path, columns)
    except DatasetInvalid:
        return None
