"""Packets of Protocol 2.0 as bytes: header, identity, length, stuffed content, checksum.

Source: ROBOTIS e-manual, DYNAMIXEL Protocol 2.0.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from nas_data.hardware.virtual_bus.crc import crc16

HEADER = b"\xff\xff\xfd\x00"
STUFFED = b"\xff\xff\xfd"  # within the content it is followed by one more 0xFD, so that no header appears there
PREFIX = 7  # header, identity and length
LONGEST = 1024  # bytes of content beyond which a length is taken for noise
BROADCAST = 0xFE
ALERT = 0x80  # bit of a status packet's error: the servo has a hardware error


class Instruction(IntEnum):
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    BULK_READ = 0x92
    BULK_WRITE = 0x93


class Error(IntEnum):
    """Why an instruction was not followed, in the lower bits of a status packet's error."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


@dataclass(frozen=True)
class Packet:
    """A packet without its wrapping.

    Attributes:
        id: Whom it is addressed to, or who sent it.
        instruction: What it asks for; 0x55 in an answer.
        parameters: The rest; an answer's begin with its error.
        sound: Whether the checksum was right.
    """

    id: int
    instruction: int
    parameters: bytes = b""
    sound: bool = True

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        content = stuff(bytes([self.instruction]) + self.parameters)
        head = HEADER + bytes([self.id]) + (len(content) + 2).to_bytes(2, "little")
        return head + content + crc16(head + content).to_bytes(2, "little")


def status(identity: int, error: int = 0, data: bytes = b"") -> bytes:
    """Return the bytes of an answer."""
    return Packet(identity, Instruction.STATUS, bytes([error]) + data).encode()


def stuff(content: bytes) -> bytes:
    """Put 0xFD behind each 0xFF 0xFF 0xFD."""
    return content.replace(STUFFED, STUFFED + b"\xfd")


def unstuff(content: bytes) -> bytes:
    """Undo `stuff`."""
    return content.replace(STUFFED + b"\xfd", STUFFED)


class PacketReader(Protocol):
    """Finds packets of some protocol in a stream of bytes."""

    def forget(self) -> None:
        """Drop an unfinished packet."""

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes in, return the packets that they complete."""


class Protocol2Reader:
    """Finds packets in a stream of bytes, whatever lies between them."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    @property
    def waiting(self) -> bool:
        """Whether a packet has begun that is not complete."""
        return bool(self._bytes)

    def forget(self) -> None:
        """Drop an unfinished packet, as a servo does when the line has fallen silent."""
        self._bytes.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes in, return the packets that they complete."""
        self._bytes += data
        found = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> Packet | None:
        """Cut the first whole packet off; None where more bytes are needed."""
        while True:
            start = self._bytes.find(HEADER)
            if start < 0:
                del self._bytes[: max(0, len(self._bytes) - len(HEADER) + 1)]  # a header may be under way
                return None
            del self._bytes[:start]
            if len(self._bytes) < PREFIX:
                return None
            length = int.from_bytes(self._bytes[5:7], "little")
            if 3 <= length <= LONGEST:
                break
            del self._bytes[: len(HEADER)]
        if len(self._bytes) < PREFIX + length:
            return None
        whole = bytes(self._bytes[: PREFIX + length])
        del self._bytes[: PREFIX + length]
        return decode(whole)


def decode(whole: bytes) -> Packet:
    """Unwrap the bytes of one packet, from its header to its checksum."""
    content = unstuff(whole[PREFIX:-2])
    sound = crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
    return Packet(whole[4], content[0], content[1:], sound)
