"""One file of a log as named columns, converted to numbers on demand."""

import datetime
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nas_data.count_of import count_of
from nas_data.dataset.rows import TextLines, format_rows
from nas_data.errors import LogError, MapError

Column: TypeAlias = pa.Array | pa.ChunkedArray | np.ndarray
SHOWN = 3  # most numbers of an example
NO_DECIMAL = "'"  # replaces points if the decimal separator is a comma, so that such cells are not read as numbers


@dataclass(frozen=True)
class LogTable:
    """Columns of one file.

    Attributes:
        path: The file.
        columns: Columns by name, as stored.
        constants: Values that occur once in the file.
        unreadable: Reason and remedy for each unreadable column, by name.
        names: Component names of columns, if the format has them.
        lines: Lines of a text file by row of the file; None for other formats.
        decimal: Decimal separator of text cells; JSON lists always use a point.
        rows: Row number in the file of each row, shape (N,); None if no row was dropped.
    """

    path: Path
    columns: Mapping[str, Column]
    constants: Mapping[str, object] = field(default_factory=dict)
    unreadable: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    lines: TextLines | None = None
    decimal: str = "."
    rows: np.ndarray | None = None

    def name_rows(self, rows: Sequence[int] | np.ndarray) -> str:
        """Describe rows of the table in words, by row numbers and lines of the file."""
        return format_rows(rows if self.rows is None else self.rows[np.asarray(rows)], self.lines)

    def column(self, name: str) -> Column:
        """Return a column as stored; categories and all kinds of text in Arrow are plain values and `string`.

        Raises:
            MapError: there is no such column; the message lists the available ones.
            LogError: the column is unreadable.
        """
        if name in self.unreadable:
            raise LogError(f"{self.path}: '{name}' {self.unreadable[name]}.")
        if name not in self.columns:
            there = ", ".join(self.columns) or "none"
            raise MapError(f"{self.path} has no column '{name}', which the map names; it has: {there}.")
        return _unify_text(self.columns[name])

    def numbers(self, name: str) -> np.ndarray:
        """Return a column as numbers.

        Returns:
            Shape (N, k); k is 1 for a plain column. Empty cells are NaN, also those of vectors, in all components.

        Raises:
            MapError: there is no such column.
            LogError: cells are not numbers, or vectors differ in length; the message has the rows.
        """
        column = self.column(name)
        if isinstance(column, np.ndarray):
            return self._from_numpy(name, column)
        kind = column.type
        if pa.types.is_string(kind):
            return self._from_text(name, column)
        if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            return self._from_lists(name, column)
        plain = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
        if not any(is_plain(kind) for is_plain in plain):
            if pa.types.is_null(kind):
                return np.full((len(column), 1), np.nan)
            raise LogError(f"{self.path}: the column '{name}' holds {kind}, not numbers; name another column.")
        # Integers beyond 2^53 lose digits that only times need; see `ticks`.
        return _convert_to_numpy(column.cast(pa.float64(), safe=False))[:, None]

    def ticks(self, name: str, unit: str) -> np.ndarray:
        """Return a time column in its own unit, shape (N,).

        Whole numbers and dates (in ns) stay int64: nanoseconds since 1970 need more than the 53 bits of a float.

        Raises:
            MapError: there is no such column.
            LogError: cells are not times in this unit.
        """
        column = self.column(name)
        if not isinstance(column, np.ndarray):
            self._refuse_nulls(name, column)
        whole = self._convert_numpy_ticks(name, column, unit) if isinstance(column, np.ndarray) else None
        if not isinstance(column, np.ndarray):
            whole = self._convert_arrow_ticks(name, column, unit)
        if whole is not None:
            return whole
        numbers = self.numbers(name)
        numbers = numbers.T if len(numbers) == 1 else numbers
        if numbers.shape[1] != 1:
            raise LogError(
                f"{self.path}: the time column '{name}' holds vectors of {numbers.shape[1]}; write one number per row, "
                "or name another column in [read.time]."
            )
        return numbers[:, 0]

    def constant(self, name: str, rows: slice | np.ndarray = slice(None)) -> object:
        """Return a constant of the file, or the value of a column that is constant in the given rows.

        Raises:
            MapError: there is no such constant or column.
            LogError: the column changes.
        """
        if name in self.constants:
            return to_plain(self.constants[name])
        if name not in self.columns:
            there = ", ".join([*self.constants, *self.columns]) or "nothing"
            raise MapError(f"{self.path} has no constant '{name}', which the map names; it holds: {there}.")
        column = self.columns[name]
        whole = column if isinstance(column, np.ndarray) else np.array([*column.to_pylist(), None], object)[:-1]
        chosen = whole[rows]
        values = [to_plain(value) for value in (chosen.astype(str) if chosen.dtype.kind in "mM" else chosen).tolist()]
        if any(value != values[0] for value in values):
            raise LogError(
                f"{self.path}: '{name}' changes within the log, so it is not a constant; give it as 'column'."
            )
        return number_or_text(values[0], self.decimal) if values else None

    def _convert_numpy_ticks(self, name: str, column: np.ndarray, unit: str) -> np.ndarray | None:
        """Return an array of integers or dates as integers, shape (N,); None for others."""
        is_date = column.dtype.kind in "mM"
        self._check_date(name, column, is_date, unit)
        if is_date:
            return column.astype(f"{column.dtype.kind}8[ns]").astype(np.int64)
        return column.astype(np.int64) if column.ndim == 1 and column.dtype.kind in "iu" else None

    def _convert_arrow_ticks(self, name: str, column: pa.Array, unit: str) -> np.ndarray | None:
        """Return a column of integers or dates, also as text, as integers, shape (N,); None for others."""
        if pa.types.is_string(column.type):
            column = pc.utf8_trim_whitespace(column)
            if unit != "datetime":
                self._check_date(name, column, _read_dates(column[:1]) is not None and len(column) > 0, unit)
            whole = _read_dates(column) if unit == "datetime" else _cast(column, pa.int64())
            if whole is not None:
                return _convert_to_numpy(whole.cast(pa.int64()))
        is_duration = pa.types.is_duration(column.type)
        is_date = is_duration or pa.types.is_timestamp(column.type) or pa.types.is_date(column.type)
        self._check_date(name, column, is_date, unit)
        if is_date:
            fine = pa.duration("ns") if is_duration else pa.timestamp("ns", getattr(column.type, "tz", None))
            column = column.cast(fine).cast(pa.int64())
        # signed, so that a decreasing time becomes a negative step and not a huge one
        return _convert_to_numpy(column.cast(pa.int64())) if pa.types.is_integer(column.type) else None

    def _check_date(self, name: str, column: Column, is_date: bool, unit: str) -> None:
        if is_date and unit != "datetime":
            raise LogError(
                f"{self.path}: the time column '{name}' holds dates or durations; set unit = 'datetime' instead of "
                f"'{unit}'."
            )
        if unit == "datetime" and not is_date:
            first = f", such as {str(column[0])!r}" if len(column) else ""
            raise LogError(
                f"{self.path}: the time column '{name}' holds no dates{first}; write them as 2025-12-31T23:59:59.25, "
                "or as numbers, with their unit."
            )

    def _from_numpy(self, name: str, column: np.ndarray) -> np.ndarray:
        if column.dtype.kind not in "biuf" or column.ndim not in (1, 2):
            raise LogError(
                f"{self.path}: the array '{name}' has {count_of(column.ndim, 'dimension')} of {column.dtype}; "
                "save it as numbers in one or two dimensions, or name another."
            )
        return (column if column.ndim == 2 else column[:, None]).astype(np.float64)

    def _from_text(self, name: str, column: pa.Array) -> np.ndarray:
        """Parse text cells: numbers, True and False (1 and 0), or JSON lists of numbers."""
        texts = pc.utf8_trim_whitespace(column)
        first, second = [*texts.drop_null()[:2].to_pylist(), "", ""][:2]
        if not self._is_readable(first) and self._is_readable(second) and not self._has_other_point(first):
            row = int(np.argmax(column.is_valid()))
            raise LogError(
                f"{self.path}: the column '{name}' holds {str(column[row])!r} in {self.name_rows([row])} and numbers "
                "below it; if that row has units, remove it."
            )
        if first.startswith("["):
            filled = column.is_valid().to_numpy(zero_copy_only=False)
            cells = column.drop_null().to_pylist()
            return _spread(self._from_json_cells(name, cells, np.flatnonzero(filled)), filled)
        lower = pc.utf8_lower(texts)
        if first.lower() in {"true", "false"} and set(lower.unique().to_pylist()) <= {"true", "false", None}:
            return _convert_to_numpy(pc.equal(lower, "true").cast(pa.float64()))[:, None]
        try:
            return _convert_to_numpy(self._with_point(column).cast(pa.float64()))[:, None]
        except pa.ArrowInvalid:
            cells, points = column.to_pylist(), self._with_point(column).to_pylist()
            row = next(row for row, cell in enumerate(points) if cell is not None and not _is_number(cell))
            other = {".": ",", ",": "."}[self.decimal]
            is_other = self._has_other_point(cells[row])
            remedy = f"if it is one, set decimal = '{other}' at the top of the map" if is_other else "remove that row"
            if not is_other and not any(cell is not None and _is_number(cell) for cell in points):
                remedy = "no row has one: name another column, or write plain numbers"
            raise LogError(
                f"{self.path}: the column '{name}' holds {cells[row]!r} in {self.name_rows([row])}, which is not a "
                f"number; {remedy}."
            ) from None

    def _with_point(self, column: pa.Array) -> pa.Array:
        """Return stripped text cells with a decimal point; points that separate thousands are invalid."""
        column = pc.utf8_trim_whitespace(column)
        if self.decimal == ".":
            return column
        return pc.replace_substring(pc.replace_substring(column, ".", NO_DECIMAL), self.decimal, ".")

    def _has_other_point(self, cell: str) -> bool:
        """Return whether a text cell is a number with the other decimal separator."""
        return _is_number(cell.replace("," if self.decimal == "." else ".", "."))

    def _is_readable(self, cell: str) -> bool:
        """Return whether a text cell is a number, or a JSON list of numbers, which always has a decimal point."""
        return isinstance(number_or_text(cell, self.decimal), int | float) or bool(_list_of(cell))

    def _from_json_cells(self, name: str, cells: list[str], rows: np.ndarray) -> np.ndarray:
        """Parse JSON lists of numbers, shape (M, k); `rows` are those of the cells, shape (M,)."""
        try:
            return _make_matrix(json.loads(f"[{','.join(cells)}]"))
        except (ValueError, TypeError):
            width = len(_list_of(cells[0]))
            place = next((place for place, cell in enumerate(cells) if len(_list_of(cell)) != width or not width), 0)
            needed = f"a JSON list of {count_of(width, 'number')} is needed in every row"
            raise LogError(
                f"{self.path}: the column '{name}' holds {cells[place][:60]!r} in {self.name_rows(rows[[place]])}; "
                f"{needed if width else _correct_list(cells[place])}."
            ) from None

    def _from_lists(self, name: str, column: pa.Array | pa.ChunkedArray) -> np.ndarray:
        if column.null_count:
            filled = column.is_valid().to_numpy(zero_copy_only=False)
            if not filled.any():
                return np.empty((len(filled), 0))
            kept = replace(self, rows=np.flatnonzero(filled) if self.rows is None else self.rows[filled])
            return _spread(kept._from_lists(name, column.drop_null()), filled)
        lengths = pc.list_value_length(column).to_numpy(zero_copy_only=False) if len(column) else np.zeros(0)
        if len(set(lengths.tolist())) > 1:
            row = int(np.flatnonzero(lengths != lengths[0])[0])
            remedy = (
                "set joint_names = … if a column names the joints of each row, or remove such rows"
                if lengths.all()
                else "remove the empty rows, or do not use this column (of velocities: velocity = 'derive')"
            )
            raise LogError(
                f"{self.path}: the column '{name}' holds {count_of(lengths[0], 'number')} in "
                f"{self.name_rows([0])} and {lengths[row]} in {self.name_rows([row])}; {remedy}."
            )
        try:
            flat = _convert_to_numpy(pc.list_flatten(column).cast(pa.float64()))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise LogError(
                f"{self.path}: the column '{name}' holds {column.type}, not numbers; name another column."
            ) from None
        return flat.reshape(len(column), -1) if len(column) else np.zeros((0, 1))

    def _refuse_nulls(self, name: str, column: pa.ChunkedArray) -> None:
        if column.null_count:
            rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
            raise LogError(f"{self.path}: the column '{name}' is empty in {self.name_rows(rows)}; remove these rows.")


def _spread(values: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """Return rows of NaN between values, shape (M, k), so that these stand in the M rows of a mask, shape (N,)."""
    spread = np.full((len(filled), values.shape[1]), np.nan)
    spread[filled] = values
    return spread


def _correct_list(cell: str) -> str:
    """Return what to write in place of a cell that begins as a list but is none, such as NumPy's `[0. 25.2]`."""
    words = cell.strip("[] ").replace(",", " ").split()
    if not words or not all(_is_number(word) for word in words):
        return "it is not a list of numbers: name another column, or write JSON lists such as [0.5, 25.2]"
    numbers = ", ".join(json.dumps(float(word)) for word in words[:SHOWN])
    example = f"[{numbers}, …]" if len(words) > SHOWN else f"[{numbers}]"
    commas = "commas are missing between the numbers" if "," not in cell and len(words) > 1 else "that is not JSON"
    return f"{commas}: write {example}, as json.dumps(values.tolist()) does"


def to_plain(value: object) -> object:
    """Return a value as JSON can hold it: dates as ISO 8601, bytes as text, NaN as None, other types as their text."""
    if isinstance(value, Mapping):
        return {str(key): to_plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(one) for one in value]
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, float):
        return None if math.isnan(value) else value if math.isfinite(value) else str(value)
    return value if value is None or isinstance(value, str | int) else str(value)


def refuse_twice(path: Path, names: Sequence[str]) -> None:
    """Refuse duplicate column names in a header.

    Raises:
        LogError: names the column and its positions.
    """
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if twice is not None:
        places = " and ".join(str(place) for place, name in enumerate(names, start=1) if name == twice)
        raise LogError(f"{path} has the column '{twice}' twice, as columns {places}; give each its own name.")


def number_or_text(value: object, decimal: str = ".") -> object:
    """Convert text to a number if possible: CSV cells and Parquet metadata are text."""
    if not isinstance(value, str):
        return value
    text = value if decimal == "." else value.replace(".", NO_DECIMAL).replace(decimal, ".")
    if not _is_number(text):
        return value
    return int(text) if text.strip().lstrip("+-").isdecimal() else float(text)


def _unify_text(column: Column) -> Column:
    """Return Arrow's categories as their values, and its other text types as `string`."""
    if isinstance(column, np.ndarray):
        return column
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    texts = (pa.types.is_large_string, pa.types.is_string_view)
    return column.cast(pa.string()) if any(is_text(column.type) for is_text in texts) else column


def _cast(column: pa.Array, kind: pa.DataType) -> pa.Array | None:
    """Return text cells as another type; None if a cell is none."""
    try:
        return column.cast(kind)
    except pa.ArrowInvalid:
        return None


def _read_dates(column: pa.Array) -> pa.Array | None:
    """Return text cells as dates, also with a decimal comma, which ISO 8601 allows; None if a cell is none."""
    column = pc.replace_substring(column, ",", ".")
    read = (_cast(column, kind) for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")))
    return next((dates for dates in read if dates is not None), None)


def _convert_to_numpy(column: pa.Array | pa.ChunkedArray) -> np.ndarray:
    """Return an Arrow column as an array (N,); nulls become NaN."""
    if isinstance(column, pa.ChunkedArray):
        return column.to_numpy()
    return column.to_numpy(zero_copy_only=False)


def _make_matrix(rows: list[list[float]]) -> np.ndarray:
    """Return lists of numbers as an array (N, k); raise ValueError for unequal lengths or other values."""
    matrix = np.array(rows, dtype=np.float64)
    if matrix.ndim != 2:
        raise ValueError("not a list of numbers in every row")
    return matrix


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's digit grouping


def _list_of(cell: str) -> list[float]:
    """Return a cell's list of numbers; empty if it is none."""
    try:
        return list(_make_matrix([json.loads(cell)])[0])
    except (ValueError, TypeError):
        return []
