"""LeRobot's language columns: a list of messages per frame, as `lerobot-annotate` (0.6) writes them.

`language_events` holds the messages of a frame. `language_persistent` holds messages that remain valid: the same list
at every frame of an episode, each with its start time [s] since the episode's start.
"""

import json
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

CALLS = "tool_calls"
TIME = "timestamp"


def has_times(column: pa.ChunkedArray) -> bool:
    """Whether the messages of a column have times."""
    kind = column.type
    return bool(pa.types.is_list(kind) and pa.types.is_struct(kind.value_type)) and (
        kind.value_type.get_field_index(TIME) >= 0
    )


def move_times(column: pa.ChunkedArray, clocks: Sequence[tuple[np.ndarray, np.ndarray]]) -> pa.ChunkedArray:
    """Return a column with the times of its messages converted to another clock.

    Args:
        column: Lists of messages with times, N rows.
        clocks: For each row, ascending times in the old clock [s] and the same moments in the new one [s].
    """
    lists = column.combine_chunks()
    lengths = np.asarray(pc.fill_null(pc.list_value_length(lists), 0))
    messages = lists.flatten()
    times = np.array(pc.struct_field(messages, TIME), np.float64)
    ends = np.cumsum(lengths)
    for end, length, (old, new) in zip(ends.tolist(), lengths.tolist(), clocks, strict=True):
        here = slice(end - length, end)
        times[here] = np.interp(times[here], old, new) + (
            np.minimum(times[here] - old[0], 0) + np.maximum(times[here] - old[-1], 0)  # before and after the episode
        )
    kind = messages.type
    place = kind.get_field_index(TIME)
    parts = [pc.struct_field(messages, [number]) for number in range(kind.num_fields)]
    parts[place] = pa.array(times, pa.float64()).cast(kind.field(place).type)
    moved = pa.StructArray.from_arrays(parts, fields=list(kind))
    offsets = pa.array(np.concatenate([[0], ends]), pa.int32())
    empty = lists.is_null() if lists.null_count else None
    return pa.chunked_array([pa.ListArray.from_arrays(offsets, moved, type=column.type, mask=empty)])


def unify_types(columns: Sequence[pa.ChunkedArray]) -> list[pa.ChunkedArray]:
    """Return columns that can be concatenated without a change of values.

    LeRobot's writer derives a column's type from the tool calls in its file. If the calls of two files have different
    arguments, they are stored as JSON texts, which LeRobot reads equally. Concatenated directly, each call would get
    the other's arguments, empty.
    """
    first, *others = [column.type for column in columns]
    if all(_fits(first, other) for other in others) and all(_fits(a, b) for a in others for b in others):
        return list(columns)
    return [_with_texts(column) for column in columns]


def _fits(a: pa.DataType, b: pa.DataType) -> bool:
    """Whether two types differ at most in parts that are empty in one of them."""
    if a == b or pa.types.is_null(a) or pa.types.is_null(b):
        return True
    if pa.types.is_list(a) and pa.types.is_list(b):
        return _fits(a.value_type, b.value_type)
    if not (pa.types.is_struct(a) and pa.types.is_struct(b)):
        return False
    names = [field.name for field in a]
    return names == [field.name for field in b] and all(_fits(a.field(name).type, b.field(name).type) for name in names)


def _with_texts(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column with every call as a JSON text."""
    kind = column.type.value_type
    if not pa.types.is_struct(kind) or kind.get_field_index(CALLS) < 0:
        return column
    rows = column.to_pylist()
    for message in (message for row in rows for message in row or ()):
        calls = message[CALLS]
        message[CALLS] = calls and [call if isinstance(call, str) else json.dumps(call) for call in calls]
    fields = [pa.field(f.name, pa.list_(pa.string())) if f.name == CALLS else f for f in kind]
    return pa.chunked_array([pa.array(rows, pa.list_(pa.struct(fields)))])
