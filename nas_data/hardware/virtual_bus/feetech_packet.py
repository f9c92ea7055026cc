"""Packets of Feetech's STS servos: header, ID, length, instruction or error, parameters, checksum.

Source: Feetech, communication protocol of the STS/SMS series; feetech-servo-sdk 1.0.0, `protocol_packet_handler`.
"""

from dataclasses import dataclass

from nas_data.hardware.virtual_bus.packet import BROADCAST, Packet, PacketProtocol, PacketReader

HEADER = b"\xff\xff"
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


class FeetechReader(PacketReader):
    """Reads this protocol."""

    header, prefix = HEADER, 4  # bytes of header, ID and length

    def parse_length(self, head: bytes) -> int | None:
        """Return the number of bytes after the prefix; None if the bytes begin no packet."""
        return head[3] if head[2] <= BROADCAST and 2 <= head[3] <= LONGEST else None

    def decode(self, whole: bytes) -> FeetechPacket:
        """Decode the bytes of one packet, from header to checksum."""
        return FeetechPacket(whole[2], whole[4], whole[5:-1], compute_checksum(whole[2:-1]) == whole[-1])


FEETECH = PacketProtocol(1, FeetechReader, encode_status, ping_has_model=False, answers_errors=False)
