"""Checksum of Protocol 2.0: CRC-16 with polynomial x¹⁶ + x¹⁵ + x² + 1, initial value 0, most significant bit first."""

from functools import reduce

POLYNOMIAL = 0x8005  # ROBOTIS e-manual, Protocol 2.0, CRC calculation


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
