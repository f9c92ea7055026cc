"""Joint names in a log: one list to compare with the map, or one per row to reorder vectors."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pyarrow as pa

from nas_data.errors import LogError, MapError
from nas_data.importing.map import LogColumns, Map
from nas_data.importing.table import Column, LogTable

SHOWN = 8  # most names listed in a message
ROS_NAMES = ("name", "joint_names")  # fields of JointState; of JointTrajectory and the states of controllers


def arrange(table: LogTable, mapping: Map, key: str, required: bool) -> LogTable:
    """Put a table's vectors in the map's order by the joint names in its rows; compare names that it holds once.

    Rows without any of the map's joints come from another publisher and are dropped.

    Args:
        table: One file, or one topic.
        mapping: Map with the joints, the column of their names, and their names in the log if these differ.
        key: Name of the file or topic in the map.
        required: Whether the table must have that column.

    Raises:
        MapError: the table's names differ from the map's, have another order, or are absent although the map has them.
        LogError: a row names only some of the joints.
    """
    given = next((part.names for part in mapping.find_parts(key) if part.names), ())
    name = find_names_column(table, mapping) or mapping.joint_names
    if not name or (not required and name not in table.columns):
        if given and not table.names:
            raise MapError(
                f"{table.path} has no names of components, but the map gives names = [{', '.join(given)}]; name the "
                "column that has them with joint_names = … at the top of the map, or remove 'names' and give the "
                "numbers of the components: components = […]."
            )
        return table
    held = table.constants.get(name)
    rows = _read_names(table.column(name) if held is None else held)
    if isinstance(rows, tuple) and not given:
        _compare(table, mapping, rows)
        return table
    if isinstance(rows, tuple):
        rows = [rows] * len(table.column(mapping.find_parts(key)[0].columns[0]))
    return _rearrange_vectors(table, mapping, key, rows)


def find_names_column(table: LogTable, mapping: Map) -> str | None:
    """Return the column of a table's joint names, from the map or the message type; None if there is none."""
    known = (mapping.joint_names, *ROS_NAMES) if mapping.layout.topics else (mapping.joint_names,)
    return next((name for name in known if name in table.columns and _may_name_joints(table, mapping, name)), None)


def _may_name_joints(table: LogTable, mapping: Map, name: str) -> bool:
    """Whether a column can hold joint names: the map's column, or lists that are not all empty.

    A message with a single text as its name names no joint.
    """
    if name == mapping.joint_names:
        return True
    rows = _read_names(table.column(name))
    return isinstance(rows, list) and any(rows)


def _read_names(column: object) -> tuple[str, ...] | list[tuple[str, ...]]:
    """Return the joint names of the whole table, or of each row."""
    plain = column.to_pylist() if isinstance(column, pa.Array | pa.ChunkedArray) else column
    listed: list[object] = plain.tolist() if isinstance(plain, np.ndarray) else list(cast(Iterable[object], plain))
    if any(isinstance(value, list | tuple) for value in listed):
        rows = [cast(Sequence[object], value) or () for value in listed]
        return [tuple(to_text(name) for name in row) for row in rows]
    return tuple(to_text(name) for name in listed)


def to_text(name: object) -> str:
    """Return a name as text; h5py and NumPy return bytes."""
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)


def _compare(table: LogTable, mapping: Map, found: Sequence[str]) -> None:
    """Refuse names that differ from the map's, or have another order."""
    if tuple(found) == mapping.joints:
        return
    order = "in this order" if set(found) == set(mapping.joints) else "so"
    shown = ", ".join(found[:SHOWN]) + (f" … ({len(found)} in all)" if len(found) > SHOWN else "")
    raise MapError(
        f"{table.path} has the joints {shown}, but the map {', '.join(mapping.joints)}; "
        f"name them {order} in 'joints' of the map, and sort its other lists of joints likewise."
    )


def _rearrange_vectors(table: LogTable, mapping: Map, key: str, rows: list[tuple[str, ...]]) -> LogTable:
    """Reorder the vectors that the map reads to its joint order; those it picks components of stay as they are.

    Args:
        table: One file, or one topic.
        mapping: The map.
        key: Name of the file or topic in the map.
        rows: Names in each row.
    """
    parts = mapping.find_parts(key)
    default = _choose_default_names(parts, rows, mapping.joints)
    picked = {part.columns[0] for part in parts if part.components}
    wanted: dict[str, tuple[str, ...]] = {}  # names of the components of each vector
    for part in parts:
        for name in part.columns:
            if _holds_lists(table.columns.get(name)) and name not in picked:
                names = part.names or default
                if wanted.setdefault(name, names) != names:
                    raise MapError(
                        f"{table.path}: the map reads '{name}' with names = [{', '.join(wanted[name])}] and with "
                        f"[{', '.join(names)}]; give all joints one list, or read components = […] of it."
                    )
    lists = list(dict.fromkeys(wanted.values())) or [default]
    found = {each: {names: _find_indices(names, each) for names in dict.fromkeys(rows)} for each in lists}
    kept = np.array([any(kinds[names] is not None for kinds in found.values()) for names in rows])
    if not kept.any() and wanted:
        raise MapError(
            f"{table.path}: no row names a joint of the map ({', '.join(lists[0])}); the first names "
            f"{', '.join(rows[0][:SHOWN]) or 'none'}. Use the names of the log in 'joints' of the map, or give them in "
            f"the order of 'joints' with names = […] in {_name_section(mapping, key)}."
        )
    kept = kept if kept.any() else ~kept
    if picked:
        _refuse_changing_names(table, rows, kept)
        _refuse_other_components(table, mapping, key, rows[int(np.argmax(kept))], default)
    chosen = [names for names, keep in zip(rows, kept, strict=True) if keep]
    widths = [len(names) for names in chosen]
    for each in dict.fromkeys(wanted.values()):
        _refuse_partial_rows(table, mapping, key, rows, kept, each)
    places = {each: np.array([found[each][names] for names in chosen]) for each in wanted.values()}
    kept_table = _take_rows(table, kept)
    reordered = {name: _reorder(kept_table.columns[name], places[each], widths) for name, each in wanted.items()}
    return replace(kept_table, columns={**kept_table.columns, **reordered})


def _choose_default_names(
    parts: Sequence[LogColumns], rows: Sequence[tuple[str, ...]], joints: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the names of vectors without names of their own: the joints', unless no row but another part has them."""
    given = next((part.names for part in parts if part.names), joints)
    return joints if any(not set(joints).isdisjoint(names) for names in dict.fromkeys(rows)) else given


def _refuse_partial_rows(
    table: LogTable, mapping: Map, key: str, rows: Sequence[tuple[str, ...]], kept: np.ndarray, wanted: tuple[str, ...]
) -> None:
    """Refuse rows that have some of the wanted names only."""
    partial = next((int(row) for row in np.flatnonzero(kept) if not set(wanted) <= set(rows[row])), None)
    if partial is None:
        return
    missing = next(joint for joint in wanted if joint not in rows[partial])
    there = ", ".join(rows[partial][:SHOWN])
    remedy = "write its rows together with the others'"
    if mapping.layout.topics:
        remedy = f"name {mapping.layout.topics[key]} once for each joint in [topics], and set topic = [one per joint]"
    raise LogError(
        f"{table.path}: {table.name_rows([partial])} lacks the joint '{missing}'; it has {there}. A row must have "
        f"all joints of the map or none: remove this one from 'joints', or {remedy}."
    )


def _refuse_changing_names(table: LogTable, rows: list[tuple[str, ...]], kept: np.ndarray) -> None:
    """Refuse names that change from row to row where the map picks components by their numbers."""
    first = int(np.argmax(kept))
    other = next((row for row in np.flatnonzero(kept) if rows[row] != rows[first]), None)
    if other is not None:
        raise MapError(
            f"{table.path}: the map picks 'components' by their numbers, but {table.name_rows([first])} names "
            f"{', '.join(rows[first][:SHOWN])}, and {table.name_rows([other])} {', '.join(rows[other][:SHOWN])}; "
            "remove 'components', which finds the joints by name in every row."
        )


def _refuse_other_components(
    table: LogTable, mapping: Map, key: str, names: tuple[str, ...], wanted: tuple[str, ...]
) -> None:
    """Refuse components that belong to another joint by their names; joints may share those of a signal."""
    states = [one.source for one in mapping.quantities if one.name not in mapping.signals and one.source.table == key]
    for source in states:
        for joint, place in zip(wanted, source.components, strict=False):
            found = names[place] if place < len(names) else joint
            if found != joint and found in wanted:
                raise MapError(
                    f"{table.path}: the map picks component {place} for the joint '{joint}', but there it is "
                    f"'{found}'; correct 'components', or remove it, which finds the joints by name in every row."
                )


def _name_section(mapping: Map, key: str) -> str:
    """Return the map's table of a quantity that is read from a file or topic."""
    parts = mapping.find_parts(key)
    name = next(quantity.name for quantity in mapping.quantities if parts[0] in quantity.source.parts)
    return f"[signals.{name}]" if name in mapping.signals else f"[read.{name}]"


def _take_rows(table: LogTable, kept: np.ndarray) -> LogTable:
    """Return a table without the rows of other publishers; arrays with another number of rows stay whole."""
    if kept.all():
        return table
    columns = {
        name: column
        if len(column) != len(kept)
        else (column[kept] if isinstance(column, np.ndarray) else column.filter(pa.array(kept)))
        for name, column in table.columns.items()
    }
    return replace(table, columns=columns, rows=np.flatnonzero(kept))


def _find_indices(names: tuple[str, ...], joints: tuple[str, ...]) -> tuple[int, ...] | None:
    """Return the index of each joint among names, -1 for missing ones; None if all are missing."""
    places = tuple(names.index(joint) if joint in names else -1 for joint in joints)
    return None if set(places) == {-1} else places


def _holds_lists(column: Column | None) -> bool:
    """Return whether a column has a list in every row."""
    if isinstance(column, np.ndarray):
        return column.ndim == 2 or (column.dtype == object and len(column) > 0 and np.ndim(column[0]) == 1)
    kinds = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    return column is not None and any(is_kind(column.type) for is_kind in kinds)


def _reorder(column: Column, places: np.ndarray, widths: list[int]) -> Column:
    """Return a column whose vectors with one number per name are reordered; others, such as empty ones, unchanged.

    Rows without a vector are NaN.
    """
    rows = [*column] if isinstance(column, np.ndarray) else column.to_pylist()
    first = next((row for row in rows if row is not None and len(row)), None)
    if first is None or isinstance(first[0], str | bytes) or len(rows) != len(places):
        return column
    if any(row is not None and len(row) != width for row, width in zip(rows, widths, strict=True)):
        return column
    vectors = [[np.nan] * width if row is None else row for row, width in zip(rows, widths, strict=True)]
    return np.array([np.asarray(row, np.float64)[order] for row, order in zip(vectors, places, strict=True)])
