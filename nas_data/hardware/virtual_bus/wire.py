"""A half-duplex line: transmission times of replies, and collisions."""

from collections.abc import Sequence

from nas_data.hardware.virtual_bus.chain import Reply

BITS = 10  # bits per byte on the wire: start bit, eight data bits, stop bit


def compute_transmission_time(count: int, baud: int) -> float:
    """Return the transmission time of `count` bytes [s] at a baud rate [bit/s]."""
    return count * BITS / baud


def transmit(replies: Sequence[Reply], baud: int) -> list[tuple[float, bytes]]:
    """Transmit replies.

    Args:
        replies: Replies in the order in which the servos send them.
        baud: Baud rate [bit/s].

    Returns:
        Time of the last byte after the end of the instruction [s], and bytes, of each transmission.
    """
    sent: list[tuple[float, bytes]] = []
    for group in _group(replies):
        begin = sent[-1][0] if sent else 0.0
        for index, reply in enumerate(sorted(group, key=lambda reply: reply.pause)):
            end = begin + reply.pause + compute_transmission_time(len(reply.content), baud)
            if index and begin + reply.pause < sent[-1][0]:  # the other servo is still sending
                sent[-1] = (max(end, sent[-1][0]), collide(sent[-1][1], reply.content))
            else:
                sent.append((end, reply.content))
    return sent


def _group(replies: Sequence[Reply]) -> list[list[Reply]]:
    """Group replies whose return delays begin at the same time."""
    groups: list[list[Reply]] = []
    for reply in replies:
        if reply.together and groups:
            groups[-1].append(reply)
        else:
            groups.append([reply])
    return groups


def collide(first: bytes, second: bytes) -> bytes:
    """Return the received bytes of two simultaneous senders: the line is low if either sender pulls it low."""
    longer = max(first, second, key=len)
    return bytes(a & b for a, b in zip(first, second, strict=False)) + longer[min(len(first), len(second)) :]
