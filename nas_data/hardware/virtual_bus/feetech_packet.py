"""Packets of Feetech's STS servos: header, ID, length, instruction or error, parameters, checksum.

Source: Feetech, communication protocol of the STS/SMS series; feetech-servo-sdk 1.0.0, `protocol_packet_handler`.
"""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.packet import BROADCAST, Packet

HEADER = b"\xff\xff"
PREFIX = 4  # bytes of header, ID and length
LONGEST = 250  # largest valid length


@dataclass(frozen=True)
class FeetechPacket(Packet):
    """A packet of this protocol."""

    def encode(self) -> bytes:
        """Return the bytes on the wire."""
        content = bytes([self.id, len(self.parameters) + 2, self.instruction]) + self.parameters
        return HEADER + content + bytes([compute_checksum(content)])


def compute_checksum(content: bytes) -> int:
    """Return the checksum of the bytes between header and checksum: the complement of their sum, one byte."""
    return ~sum(content) & 0xFF


def encode_status(identity: int, error: int = 0, data: bytes = b"") -> bytes:
    """Return the bytes of a status packet."""
    return FeetechPacket(identity, error, data).encode()


class FeetechReader:
    """Finds packets in a stream of bytes, and skips other bytes."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def forget(self) -> None:
        """Drop an incomplete packet, as a servo does after a pause."""
        self._bytes.clear()

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the packets that they complete."""
        self._bytes += data
        found: list[Packet] = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> FeetechPacket | None:
        """Remove and return the first complete packet; None if more bytes are needed."""
        while True:
            start = self._bytes.find(HEADER)
            if start < 0:
                del self._bytes[: max(0, len(self._bytes) - 1)]  # the last byte may begin a header
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
    """Decode the bytes of one packet, from header to checksum."""
    is_valid = compute_checksum(whole[2:-1]) == whole[-1]
    return FeetechPacket(whole[2], whole[4], whole[5:-1], is_valid)
