"""Packet protocols of servos."""

from collections.abc import Callable
from dataclasses import dataclass

from nas_data.hardware.virtual_bus import feetech_packet, packet
from nas_data.hardware.virtual_bus.packet import PacketReader


@dataclass(frozen=True)
class PacketProtocol:
    """A packet protocol."""

    width: int  # bytes of an address, and of a length
    reader: Callable[[], PacketReader]  # creates a reader of packets
    status: Callable[[int, int, bytes], bytes]  # returns the bytes of a status packet from ID, error and data
    ping_has_model: bool  # whether the reply to a ping contains model and firmware
    answers_errors: bool  # whether damaged and unknown instructions are answered

    def number(self, parameters: bytes, index: int) -> int:
        """Return the address (index 0) or the length (index 1) at the start of parameters."""
        return int.from_bytes(parameters[index * self.width : (index + 1) * self.width], "little")


PROTOCOL_2 = PacketProtocol(2, packet.Protocol2Reader, packet.encode_status, ping_has_model=True, answers_errors=True)
FEETECH = PacketProtocol(
    1, feetech_packet.FeetechReader, feetech_packet.encode_status, ping_has_model=False, answers_errors=False
)
