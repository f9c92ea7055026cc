"""How servos speak: the bytes of packets, and how wide addresses are in them."""

from collections.abc import Callable
from dataclasses import dataclass

from nas_data.hardware.virtual_bus import feetech_packet, packet
from nas_data.hardware.virtual_bus.packet import PacketReader


@dataclass(frozen=True)
class PacketProtocol:
    """One way to speak.

    Attributes:
        width: Bytes of an address and of a length.
        reader: Makes what finds instructions in a stream.
        status: Makes the bytes of an answer of identity, error and data.
        names_model: Whether the answer to a ping tells model and firmware.
        complains: Whether an instruction that is damaged or not known is answered at all.
    """

    width: int
    reader: Callable[[], PacketReader]
    status: Callable[[int, int, bytes], bytes]
    names_model: bool
    complains: bool

    def number(self, parameters: bytes, place: int) -> int:
        """Return an address or a length by its place among the first parameters."""
        return int.from_bytes(parameters[place * self.width : (place + 1) * self.width], "little")


PROTOCOL_2 = PacketProtocol(2, packet.Protocol2Reader, packet.status, names_model=True, complains=True)
FEETECH = PacketProtocol(1, feetech_packet.FeetechReader, feetech_packet.status, names_model=False, complains=False)
