"""Packets of Feetech's STS servos as bytes: header, identity, length, instruction or error, parameters, checksum.

Source: Feetech, communication protocol of the STS/SMS series; feetech-servo-sdk 1.0.0, `protocol_packet_handler`.
"""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.packet import BROADCAST, Packet

HEADER = b"\xff\xff"
PREFIX = 4  # header, identity and length
LONGEST = 250  # bytes that a length may count


@dataclass(frozen=True)
class FeetechPacket(Packet):
    """A packet of this protocol."""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        content = bytes([self.id, len(self.parameters) + 2, self.instruction]) + self.parameters
        return HEADER + content + bytes([checksum(content)])


def checksum(content: bytes) -> int:
    """Return the checksum of what stands between header and checksum: the complement of the sum, one byte."""
    return ~sum(content) & 0xFF


def status(identity: int, error: int = 0, data: bytes = b"") -> bytes:
    """Return the bytes of an answer."""
    return FeetechPacket(identity, error, data).encode()


class FeetechReader:
    """Finds packets in a stream of bytes, whatever lies between them."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def forget(self) -> None:
        """Drop an unfinished packet, as a servo does when the line has fallen silent."""
        self._bytes.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Take bytes in, return the packets that they complete."""
        self._bytes += data
        found: list[Packet] = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> FeetechPacket | None:
        """Cut the first whole packet off; None where more bytes are needed."""
        while True:
            start = self._bytes.find(HEADER)
            if start < 0:
                del self._bytes[: max(0, len(self._bytes) - 1)]  # a header may be under way
                return None
            del self._bytes[:start]
            if len(self._bytes) < PREFIX:
                return None
            identity, length = self._bytes[2], self._bytes[3]
            if identity <= BROADCAST and 2 <= length <= LONGEST:
                break
            del self._bytes[0]
        if len(self._bytes) < PREFIX + length:
            return None
        whole = bytes(self._bytes[: PREFIX + length])
        del self._bytes[: PREFIX + length]
        return decode(whole)


def decode(whole: bytes) -> FeetechPacket:
    """Unwrap the bytes of one packet, from its header to its checksum."""
    sound = checksum(whole[2:-1]) == whole[-1]
    return FeetechPacket(whole[2], whole[4], whole[5:-1], sound)
