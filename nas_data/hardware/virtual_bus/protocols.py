"""Packet protocols of servos."""

from collections.abc import Callable
from dataclasses import dataclass

from nas_data.hardware.virtual_bus import feetech_packet, packet
from nas_data.hardware.virtual_bus.packet import PacketReader


@dataclass(frozen=True)
class PacketProtocol:
    """A packet protocol.

    Attributes:
        width: Bytes of an address, and of a length.
        reader: Creates a reader of packets.
        status: Returns the bytes of a status packet from ID, error and data.
        ping_has_model: Whether the reply to a ping contains model and firmware.
        answers_errors: Whether damaged and unknown instructions are answered.
    """

    width: int
    reader: Callable[[], PacketReader]
    status: Callable[[int, int, bytes], bytes]
    ping_has_model: bool
    answers_errors: bool

    def number(self, parameters: bytes, index: int) -> int:
        """Return the address (index 0) or the length (index 1) at the start of parameters."""
        return int.from_bytes(parameters[index * self.width : (index + 1) * self.width], "little")


PROTOCOL_2 = PacketProtocol(2, packet.Protocol2Reader, packet.encode_status, ping_has_model=True, answers_errors=True)
FEETECH = PacketProtocol(
    1, feetech_packet.FeetechReader, feetech_packet.encode_status, ping_has_model=False, answers_errors=False
)
