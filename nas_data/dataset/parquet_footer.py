"""Repair of a Parquet file whose writer was killed: a new footer for its complete row groups.

Parquet writes the pages of each row group at once and their directory (the footer) last. LeRobot writes a row group at
the end of each episode and the footer at the end of the session. A kill in between leaves every saved episode on the
disk, but no directory. Each page has a header with its size and number of values. The directory can therefore be
rebuilt by walking from page to page, with the columns of a complete file as the template. Formats:
https://parquet.apache.org/docs/file-format/ (parquet.thrift) and Thrift's compact protocol,
https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from nas_data.dataset.parquet_thrift import I64, LIST, Fields, Items, Struct, Value, parse, serialize

MAGIC = b"PAR1"
DATA_PAGE, DICTIONARY_PAGE, DATA_PAGE_V2 = 0, 2, 3  # PageType
ROW_GROUPS, NUM_ROWS = 4, 3  # fields of FileMetaData
MOST_PAGES = 1000  # of one column in one episode; more would be a billion rows


@dataclass(frozen=True)
class ParquetPage:
    """A page in a file.

    Attributes:
        start: Offset of its header [bytes].
        stop: Offset after its last byte [bytes].
        values: Number of values, 0 for a dictionary.
        unpacked: Its size before compression, header included [bytes].
        dictionary: Whether it is a dictionary page; only the first page of a column can be one.
    """

    start: int
    stop: int
    values: int
    unpacked: int
    dictionary: bool


def rebuild_footer(content: bytes, template: bytes, widths: Sequence[int]) -> tuple[bytes, int]:
    """Return the complete row groups of a Parquet file with a new footer.

    Args:
        content: The truncated file.
        template: A complete Parquet file with the same columns and at least one row group.
        widths: Values per row of each leaf column.

    Returns:
        The repaired file, and the number of its row groups, which may be zero.
    """
    footer = _read_footer(template)
    groups = footer[ROW_GROUPS][1]
    if not isinstance(groups, Items) or not groups.values or not content.startswith(MAGIC):
        return content, 0
    pattern = groups.values[0]
    assert isinstance(pattern, Struct)
    pages = list(walk(content))
    made: list[Value] = []
    index, rows = 0, 0
    while found := _find_row_group(pages, index, widths):
        columns, length = found
        made.append(_describe(pattern, columns, length, len(made)))
        index, rows = index + sum(len(column) for column in columns), rows + length
    end = pages[index - 1].stop if index else len(MAGIC)
    tail = serialize(Struct({**footer, NUM_ROWS: (I64, rows), ROW_GROUPS: (LIST, Items(groups.kind, made))}))
    return content[:end] + tail + len(tail).to_bytes(4, "little") + MAGIC, len(made)


def walk(content: bytes) -> Iterator[ParquetPage]:
    """Yield the pages in order, up to the first one that is truncated or invalid."""
    offset = len(MAGIC)
    while offset < len(content):
        try:
            header, body = parse(content, offset)
            kind, unpacked, packed = (_read_integer(header, key) for key in (1, 2, 3))
            details = header[{DATA_PAGE: 5, DICTIONARY_PAGE: 7, DATA_PAGE_V2: 8}[kind]][1]
            assert isinstance(details, Struct)
            values = _read_integer(details.fields, 1)
        except (LookupError, ValueError, AssertionError):
            return
        stop = body + packed
        if packed < 0 or stop > len(content):
            return
        is_dictionary = kind == DICTIONARY_PAGE
        yield ParquetPage(offset, stop, 0 if is_dictionary else values, unpacked + body - offset, is_dictionary)
        offset = stop


def _find_row_group(
    pages: Sequence[ParquetPage], index: int, widths: Sequence[int]
) -> tuple[list[Sequence[ParquetPage]], int] | None:
    """Return the pages of each column of the row group that begins at page `index`, and its number of rows.

    None if it is truncated. The number of rows is stored in the footer only, so the smallest one that all columns allow
    is taken.
    """
    values = 0
    for count in range(1, MOST_PAGES):
        if index + count > len(pages):
            return None
        values += pages[index + count - 1].values
        if not values or values % widths[0]:
            continue
        columns = _split_columns(pages, index, [values // widths[0] * width for width in widths])
        if columns:
            return columns, values // widths[0]
    return None


def _split_columns(
    pages: Sequence[ParquetPage], index: int, values: Sequence[int]
) -> list[Sequence[ParquetPage]] | None:
    """Return the pages of each column if they hold exactly the given numbers of values; else None."""
    columns = []
    for wanted in values:
        start, held = index, 0
        while held < wanted:
            if index >= len(pages) or (pages[index].dictionary and index > start):
                return None
            held += pages[index].values
            index += 1
        if held > wanted:
            return None
        columns.append(pages[start:index])
    return columns


def _describe(pattern: Struct, columns: Sequence[Sequence[ParquetPage]], rows: int, number: int) -> Struct:
    """Return the directory entry of a row group, modelled on the template's."""
    chunks = pattern.fields[1][1]
    assert isinstance(chunks, Items)
    described: list[Value] = [
        _make_column_chunk(chunk, pages) for chunk, pages in zip(chunks.values, columns, strict=True)
    ]
    unpacked = sum(page.unpacked for pages in columns for page in pages)
    return Struct({1: (LIST, Items(chunks.kind, described)), 2: (I64, unpacked), 3: (I64, rows)})


def _make_column_chunk(pattern: Value, pages: Sequence[ParquetPage]) -> Struct:
    """Return the directory entry of a column in a row group."""
    assert isinstance(pattern, Struct)
    kept = pattern.fields[3][1]
    assert isinstance(kept, Struct)
    data = next(page for page in pages if not page.dictionary)
    meta: Fields = {key: kept.fields[key] for key in (1, 2, 3, 4)}  # type, encodings, path, codec
    meta[5] = (I64, sum(page.values for page in pages))
    meta[6] = (I64, sum(page.unpacked for page in pages))
    meta[7] = (I64, pages[-1].stop - pages[0].start)
    meta[9] = (I64, data.start)
    if pages[0].dictionary:
        meta[11] = (I64, pages[0].start)
    return Struct({2: (I64, pages[-1].stop), 3: (pattern.fields[3][0], Struct(meta))})


def _read_footer(content: bytes) -> Fields:
    """Return the footer of a complete file."""
    return parse(content, len(content) - 8 - int.from_bytes(content[-8:-4], "little"))[0]


def _read_integer(fields: Fields, key: int) -> int:
    value = fields[key][1]
    assert isinstance(value, int)
    return value
