"""Packets of Protocol 2.0: header, ID, length, content with byte stuffing, checksum.

The checksum is CRC-16 with polynomial x¹⁶ + x¹⁵ + x² + 1, initial value 0, most significant bit first.

Source: ROBOTIS e-manual, DYNAMIXEL Protocol 2.0.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import reduce

POLYNOMIAL = 0x8005  # ROBOTIS e-manual, Protocol 2.0, CRC calculation

HEADER = b"\xff\xff\xfd\x00"
STUFFED = b"\xff\xff\xfd"  # in the content an additional 0xFD follows it, so that the content contains no header
PREFIX = 7  # bytes of header, ID and length
LONGEST = 1024  # largest length; a larger one is taken for noise
BROADCAST = 0xFE
ALERT = 0x80  # bit of a status packet's error: the servo has a hardware error


class Instruction(IntEnum):
    """Instruction of a packet."""

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
    """Error of an instruction, in the lower bits of a status packet's error byte."""

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
    """A decoded packet."""

    id: int  # ID of the addressee, or of the sender of a status packet
    instruction: int  # instruction; 0x55 for a status packet
    parameters: bytes = b""  # parameters; those of a status packet begin with its error byte
    is_valid: bool = True  # whether the checksum is correct

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        content = stuff(bytes([self.instruction]) + self.parameters)
        head = HEADER + bytes([self.id]) + (len(content) + 2).to_bytes(2, "little")
        return head + content + compute_crc16(head + content).to_bytes(2, "little")


def encode_status(identity: int, error: int = 0, data: bytes = b"") -> bytes:
    """Return the bytes of a status packet."""
    return Packet(identity, Instruction.STATUS, bytes([error]) + data).encode()


def stuff(content: bytes) -> bytes:
    """Insert 0xFD after each 0xFF 0xFF 0xFD."""
    return content.replace(STUFFED, STUFFED + b"\xfd")


def unstuff(content: bytes) -> bytes:
    """Undo `stuff`."""
    return content.replace(STUFFED + b"\xfd", STUFFED)


class PacketReader(ABC):
    """Finds packets of a protocol in a stream of bytes, and skips other bytes."""

    header: bytes
    prefix: int  # bytes of a packet from which its length is known

    def __init__(self) -> None:
        self._bytes = bytearray()

    @abstractmethod
    def parse_length(self, head: bytes) -> int | None:
        """Return the number of bytes after the prefix; None if the bytes begin no packet."""

    @abstractmethod
    def decode(self, whole: bytes) -> Packet:
        """Decode the bytes of one packet, from header to checksum."""

    @property
    def waiting(self) -> bool:
        """Whether an incomplete packet is buffered."""
        return bool(self._bytes)

    def forget(self) -> None:
        """Drop an incomplete packet, as a servo does after a pause."""
        self._bytes.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the packets that they complete."""
        self._bytes += data
        found = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> Packet | None:
        """Remove and return the first complete packet; None if more bytes are needed."""
        while True:
            start = self._bytes.find(self.header)
            if start < 0:
                del self._bytes[: max(0, len(self._bytes) - len(self.header) + 1)]  # the last bytes may begin a header
                return None
            del self._bytes[:start]
            if len(self._bytes) < self.prefix:
                return None
            length = self.parse_length(bytes(self._bytes[: self.prefix]))
            if length is not None:
                break
            del self._bytes[0]
        if len(self._bytes) < self.prefix + length:
            return None
        whole = bytes(self._bytes[: self.prefix + length])
        del self._bytes[: self.prefix + length]
        return self.decode(whole)


class Protocol2Reader(PacketReader):
    """Reads Protocol 2.0."""

    header, prefix = HEADER, PREFIX

    def parse_length(self, head: bytes) -> int | None:
        """Return the number of bytes after the prefix; None if the bytes begin no packet."""
        length = int.from_bytes(head[5:7], "little")
        return length if 3 <= length <= LONGEST else None

    def decode(self, whole: bytes) -> Packet:
        """Decode the bytes of one packet, from header to checksum."""
        content = unstuff(whole[PREFIX:-2])
        is_valid = compute_crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
        return Packet(whole[4], content[0], content[1:], is_valid)


def _compute_table_entry(high: int) -> int:
    """Return the remainder of one byte, shifted by 8 bits, divided by the polynomial."""
    return reduce(
        lambda rest, _: ((rest << 1) ^ POLYNOMIAL if rest & 0x8000 else rest << 1) & 0xFFFF, range(8), high << 8
    )


TABLE = tuple(map(_compute_table_entry, range(256)))


def compute_crc16(data: bytes) -> int:
    """Return the checksum of a packet without its last two bytes, 0 … 65535."""
    register = 0
    for byte in data:
        register = ((register << 8) & 0xFFFF) ^ TABLE[(register >> 8) ^ byte]
    return register


@dataclass(frozen=True)
class PacketProtocol:
    """A packet protocol of servos."""

    width: int  # bytes of an address, and of a length
    reader: Callable[[], PacketReader]  # creates a reader of packets
    status: Callable[[int, int, bytes], bytes]  # returns the bytes of a status packet from ID, error and data
    ping_has_model: bool  # whether the reply to a ping contains model and firmware
    answers_errors: bool  # whether damaged and unknown instructions are answered

    def number(self, parameters: bytes, index: int) -> int:
        """Return the address (index 0) or the length (index 1) at the start of parameters."""
        return int.from_bytes(parameters[index * self.width : (index + 1) * self.width], "little")


PROTOCOL_2 = PacketProtocol(2, Protocol2Reader, encode_status, ping_has_model=True, answers_errors=True)
