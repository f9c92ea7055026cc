"""Frozen dataclasses as JSON and back: one record class defines both the written and the read form of a file.

A key is the field's name, or the one in the field's metadata (`field(metadata={"key": "effect"})`). A None field with
`optional` in its metadata is omitted. The keys of a record in an `inline` field are merged into those of the other
fields. A field with a default may be missing in the file; unknown keys are ignored. If a field allows several record
types, the first whose keys are present is read.
"""

import math
import types
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Union, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record")
SHOWN = 40  # characters of a wrong value shown in an error
WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


class FormError(ValueError):
    """A JSON value does not have the form of a record."""


class LacksKeys(FormError):
    """A JSON object lacks keys that a record needs.

    Attributes:
        keys: Their names.
    """

    def __init__(self, where: str, keys: Sequence[str]) -> None:
        super().__init__(f"{where or 'it'} lacks {', '.join(keys)}")
        self.keys = tuple(keys)


def as_object(record: "DataclassInstance") -> dict[str, object]:
    """Return a record as an object for `json.dumps`."""
    result: dict[str, object] = {}
    for item in fields(record):
        held, key = getattr(record, item.name), find_key(item)
        if is_inline(item):
            result |= as_object(held)
        elif key and not (held is None and is_optional(item)):
            result[key] = to_json(held)
    return result


def to_json(value: object) -> object:
    """Return a field's value for `json.dumps`."""
    if is_dataclass(value) and not isinstance(value, type):
        return as_object(value)
    if isinstance(value, Mapping):
        return {str(key): to_json(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(held) for held in value]
    return value


def from_json(kind: type[Record], value: object, where: str = "") -> Record:
    """Read a record.

    Args:
        kind: Its dataclass.
        value: Output of `json.loads`.
        where: Name of the value in errors, for example `effects[0]`.

    Raises:
        FormError: the value has another form; says where.
        LacksKeys: it lacks keys.
    """
    if not isinstance(value, Mapping):
        raise make_form_error(value, "an object", where)
    items, hints = fields(kind), get_type_hints(kind)  # type: ignore[arg-type]
    known = {item.name: (key, item) for item in items if not is_inline(item) and (key := find_key(item))}
    lacking = sorted(key for key, item in known.values() if key not in value and is_needed(item))
    if lacking:
        raise LacksKeys(where, lacking)
    held = {
        name: convert(hints[name], value[key], f"{where}.{key}" if where else key)
        for name, (key, _) in known.items()
        if key in value
    }
    inlined = {item.name: convert(hints[item.name], value, where) for item in items if is_inline(item)}
    return kind(**held, **inlined)


def convert(kind: Any, value: object, where: str) -> object:
    """Convert a JSON value to the type of a field; raises like `from_json`."""
    if kind is object:  # a part whose form is defined elsewhere
        return value
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in inner:
            return None
        *others, last = (one for one in inner if one is not type(None))
        for kind in others:
            with suppress(LacksKeys):
                return convert(kind, value, where)
        return convert(last, value, where)
    if origin is tuple:
        if not isinstance(value, list | tuple) or (inner[-1] is not Ellipsis and len(value) != len(inner)):
            raise make_form_error(value, "a list" if inner[-1] is Ellipsis else f"a list of {len(inner)}", where)
        kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(
            convert(one, held, f"{where}[{i}]") for i, (one, held) in enumerate(zip(kinds, value, strict=True))
        )
    if origin is not None:  # a mapping from texts
        if not isinstance(value, Mapping):
            raise make_form_error(value, "an object", where)
        return {str(key): convert(inner[1], held, f"{where}.{key}") for key, held in value.items()}
    if is_dataclass(kind):
        return from_json(kind, value, where)  # type: ignore[arg-type]  # a class, never one of its instances
    wanted = (int, float) if kind is float else kind
    if not isinstance(value, wanted) or isinstance(value, bool) != (kind is bool):
        raise make_form_error(value, WORDS[kind], where)
    return float(value) if kind is float else value


def make_form_error(value: object, wanted: str, where: str) -> FormError:
    """Return the error for a value of another type than wanted."""
    return FormError(f"{where or 'it'} is {str(value)[:SHOWN]!r}, not {wanted}")


def find_key(item: "Field[Any]") -> str | None:
    """Return the JSON key of a field; None if it is stored elsewhere."""
    key = item.metadata.get("key", item.name)
    return None if key is None else str(key)


def is_inline(item: "Field[Any]") -> bool:
    """Whether the keys of a field's record are merged into those of the other fields."""
    return bool(item.metadata.get("inline"))


def is_optional(item: "Field[Any]") -> bool:
    """Whether a field is omitted when None."""
    return bool(item.metadata.get("optional"))


def is_needed(item: "Field[Any]") -> bool:
    """Whether a field has no default."""
    return item.default is MISSING and item.default_factory is MISSING


def make_finite(value: object) -> object:
    """Replace values that JSON lacks (NaN, infinity, arrays, paths) by values that it has."""
    if isinstance(value, Mapping):
        return {str(key): make_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [make_finite(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return make_finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
