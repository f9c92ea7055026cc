"""Joint names in a log: one list to compare with the map, or one per row to reorder vectors."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pyarrow as pa

from nas_data.errors import LogError, MapError
from nas_data.importing.map import Map
from nas_data.importing.table import Column, LogTable

SHOWN = 8  # most names listed in a message
ROS_NAMES = ("name", "joint_names")  # fields of JointState; of JointTrajectory and the states of controllers


def arrange(table: LogTable, mapping: Map, key: str, required: bool) -> LogTable:
    """Compare a table's joint names with the map, or reorder its vectors if each row has names.

    Rows without any of the map's joints come from another publisher and are dropped.

    Args:
        table: One file, or one topic.
        mapping: Map with the joints and the column of their names.
        key: Name of the file or topic in the map.
        required: Whether the table must have that column.

    Raises:
        MapError: the table's names differ from the map's, or have another order.
        LogError: a row names only some of the joints.
    """
    found = find_names_column(table, mapping)
    if not mapping.joint_names:
        if found is not None:
            _refuse_other_order(table, mapping, key, found)
        return table
    name = found or mapping.joint_names
    if not required and name not in table.columns:
        return table
    held = table.constants.get(name)
    rows = _read_names(table.column(name) if held is None else held)
    if isinstance(rows, tuple):
        _compare(table, mapping, rows)
        return table
    return _rearrange_vectors(table, mapping, key, rows)


def find_names_column(table: LogTable, mapping: Map) -> str | None:
    """Return the column of a table's joint names, from the map or the message type; None if there is none."""
    known = (mapping.joint_names, *ROS_NAMES) if mapping.layout.topics else (mapping.joint_names,)
    return next((name for name in known if name in table.columns and _may_name_joints(table, mapping, name)), None)


def _may_name_joints(table: LogTable, mapping: Map, name: str) -> bool:
    """Whether a column can hold joint names: the map's column, or a list per row; a single text is no joint name."""
    return name == mapping.joint_names or isinstance(_read_names(table.column(name)), list)


def _refuse_other_order(table: LogTable, mapping: Map, key: str, column: str) -> None:
    """Refuse messages with the joints in another order, if the map neither reads names nor selects components."""
    read = [mapping.position, mapping.velocity, mapping.command, *mapping.signals.values()]
    here = [quantity.source for quantity in read if quantity and quantity.source.table == key]
    rows, picked = _read_names(table.column(column)), bool(here) and all(source.components for source in here)
    other = next((row for row in rows if set(row) == set(mapping.joints) and row != mapping.joints), None)
    if other is not None and not picked:
        raise MapError(
            f"{table.path} has the joints {', '.join(other)}, but the map {', '.join(mapping.joints)}; "
            f"set joint_names = '{column}' at the top of the map, which sorts them in the map's order."
        )


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
    """Reorder vectors with one number per name to the map's joint order."""
    kinds = {names: _find_indices(names, mapping.joints) for names in dict.fromkeys(rows)}
    kept = np.array([kinds[names] is not None for names in rows])
    if not kept.any():
        raise MapError(
            f"{table.path}: no row names a joint of the map ({', '.join(mapping.joints)}); the first names "
            f"{', '.join(rows[0][:SHOWN]) or 'none'}. Use the names of the log in 'joints' of the map."
        )
    partial = next((row for row, names in enumerate(rows) if -1 in (kinds[names] or ())), None)
    if partial is not None:
        missing = next(joint for joint in mapping.joints if joint not in rows[partial])
        there = ", ".join(rows[partial][:SHOWN])
        remedy = "write its rows together with the others'"
        if mapping.layout.topics:
            remedy = (
                f"name {mapping.layout.topics[key]} once for each joint in [topics], and set topic = [one per joint]"
            )
        raise LogError(
            f"{table.path}: {table.name_rows([partial])} lacks the joint '{missing}'; it has {there}. A row must have "
            f"all joints of the map or none: remove this one from 'joints', or {remedy}."
        )
    places = np.array([kinds[names] for names, keep in zip(rows, kept, strict=True) if keep])
    widths = [len(names) for names, keep in zip(rows, kept, strict=True) if keep]
    columns: dict[str, Column] = {}
    for name, column in table.columns.items():
        columns[name] = _rearrange_column(column, kept, places, widths)
    return replace(table, columns=columns, rows=np.flatnonzero(kept))


def _find_indices(names: tuple[str, ...], joints: tuple[str, ...]) -> tuple[int, ...] | None:
    """Return the index of each joint among names, -1 for missing ones; None if all are missing."""
    places = tuple(names.index(joint) if joint in names else -1 for joint in joints)
    return None if set(places) == {-1} else places


def _rearrange_column(column: Column, kept: np.ndarray, places: np.ndarray, widths: list[int]) -> Column:
    """Return the kept rows of a column; vectors with one number per name are reordered."""
    if isinstance(column, np.ndarray):
        chosen = column[kept]
        listed = [*chosen] if chosen.ndim == 2 or chosen.dtype == object else None
    else:
        chosen = column.filter(pa.array(kept))
        nested = pa.types.is_list(column.type) or pa.types.is_large_list(column.type)
        listed = chosen.to_pylist() if nested or pa.types.is_fixed_size_list(column.type) else None
    fits = listed is not None and all(
        not isinstance(row, str | bytes) and row is not None and len(row) == width
        for row, width in zip(listed, widths, strict=True)
    )
    if not fits or listed is None or isinstance(listed[0][0], str | bytes):
        return chosen
    return np.array([np.asarray(row, np.float64)[order] for row, order in zip(listed, places, strict=True)])
