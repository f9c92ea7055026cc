"""Tables as text: aligned columns for a terminal, or Markdown."""

from collections.abc import Collection, Sequence


def align_columns(rows: Sequence[Sequence[str]], left: Collection[int] = (0,), least: int = 0) -> list[str]:
    """Return a table as lines; columns are two spaces apart.

    Args:
        rows: Cells, heading first; all rows have the same length.
        left: Indices of left-aligned columns; the others are right-aligned.
        least: Smallest width of a right-aligned column.
    """
    columns = []
    for number, cells in enumerate(zip(*rows, strict=True)):
        width = max(map(len, cells))
        columns.append([cell.ljust(width) if number in left else cell.rjust(max(width, least)) for cell in cells])
    return ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]


def format_table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with a rule below its heading: the first column left-aligned, the others right-aligned."""
    heading, *lines = align_columns([headers, *rows])
    rule = align_columns([["-" * max(map(len, cells)) for cells in zip(headers, *rows, strict=True)]])
    return "\n".join([heading, *rule, *lines])


def format_markdown_table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in (headers, ["---"] * len(headers), *rows))
