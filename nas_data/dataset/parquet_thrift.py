"""Thrift's compact protocol, in which Parquet writes its page headers and its footer.

Specification: https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md. Values keep their
wire type, so that what is parsed is written back as it was. Maps and sets do not occur in Parquet and are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST = 1, 2, 3, 4, 5, 6, 7, 8, 9
STRUCT = 12
INTEGERS = {I16, I32, I64}
DEEPEST = 20  # nested values; Parquet has six
LONGEST_VARINT = 10  # bytes of 64 bits, seven each


@dataclass(frozen=True)
class Items:
    """A list: the wire type of its items, and the items."""

    kind: int
    values: Sequence["Value"]


@dataclass(frozen=True)
class Struct:
    """A structure: number of each field → its wire type and value."""

    fields: "Fields"


Value: TypeAlias = bool | int | bytes | Items | Struct
Fields: TypeAlias = dict[int, tuple[int, Value]]


def parse(content: bytes, offset: int) -> tuple[Fields, int]:
    """Read a structure.

    Args:
        content: Bytes.
        offset: Offset of the structure [bytes].

    Returns:
        Its fields, and the offset of the next byte.

    Raises:
        ValueError: no structure, or one that is cut off.
    """
    return _Reader(content, offset).read_message()


def serialize(struct: Struct) -> bytes:
    """Return the bytes of a structure."""
    out, previous = bytearray(), 0
    for number, (kind, value) in sorted(struct.fields.items()):
        if 0 < number - previous < 16:
            out.append((number - previous) << 4 | kind)
        else:
            out.append(kind)
            out += _encode_varint(_encode_zigzag(number))
        if kind not in (TRUE, FALSE):
            out += _encode_value(kind, value)
        previous = number
    out.append(0)
    return bytes(out)


def _encode_value(kind: int, value: Value) -> bytes:
    """Return the bytes of a value that is no boolean field."""
    if isinstance(value, Struct):
        return serialize(value)
    if isinstance(value, Items):
        size = len(value.values)
        head = bytes([size << 4 | value.kind]) if size < 15 else bytes([0xF0 | value.kind]) + _encode_varint(size)
        return head + b"".join(_encode_value(value.kind, item) for item in value.values)
    if isinstance(value, bytes):
        return value if kind in (BYTE, DOUBLE) else _encode_varint(len(value)) + value
    if isinstance(value, bool):
        return bytes([TRUE if value else FALSE])  # in a list; a field's value is its type
    return _encode_varint(_encode_zigzag(value))


def _encode_zigzag(number: int) -> int:
    return (number << 1) ^ (number >> 63)


def _encode_varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


class _Reader:
    """Reads values from bytes at an advancing offset."""

    def __init__(self, content: bytes, offset: int) -> None:
        self.content = content
        self.offset = offset

    def read_message(self) -> tuple[Fields, int]:
        """Read a structure and return its fields and the offset after it."""
        return self.struct(0).fields, self.offset

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        if size < 0 or self.offset + size > len(self.content):
            raise ValueError("the structure is cut off")
        self.offset += size
        return self.content[self.offset - size : self.offset]

    def varint(self) -> int:
        """Read a number without sign."""
        number = 0
        for index in range(LONGEST_VARINT):
            byte = self.take(1)[0]
            number |= (byte & 0x7F) << 7 * index
            if byte < 0x80:
                return number
        raise ValueError("a number has no end")

    def integer(self) -> int:
        """Read a number with sign."""
        number = self.varint()
        return (number >> 1) ^ -(number & 1)

    def struct(self, depth: int) -> Struct:
        """Read a structure."""
        if depth > DEEPEST:
            raise ValueError("structures are nested without end")
        fields: Fields = {}
        number = 0
        while byte := self.take(1)[0]:
            kind, step = byte & 0x0F, byte >> 4
            number = number + step if step else self.integer()
            fields[number] = (kind, kind == TRUE if kind in (TRUE, FALSE) else self.value(kind, depth))
        return Struct(fields)

    def value(self, kind: int, depth: int) -> Value:
        """Read a value that is no boolean field."""
        if kind in INTEGERS:
            return self.integer()
        if kind == BINARY:
            return self.take(self.varint())
        if kind == STRUCT:
            return self.struct(depth + 1)
        if kind == LIST:
            return self.items(depth)
        if kind in (BYTE, DOUBLE):
            return self.take(1 if kind == BYTE else 8)
        if kind in (TRUE, FALSE):
            return self.take(1)[0] == TRUE
        raise ValueError(f"there is no wire type {kind} in Parquet")

    def items(self, depth: int) -> Items:
        """Read a list."""
        byte = self.take(1)[0]
        kind, size = byte & 0x0F, byte >> 4
        if size == 15:
            size = self.varint()
        if size > len(self.content):
            raise ValueError("a list is longer than the file")
        return Items(kind, [self.value(kind, depth + 1) for _ in range(size)])
