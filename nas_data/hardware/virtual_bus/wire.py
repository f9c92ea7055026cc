"""What a half-duplex line makes of replies: when each byte has passed, and what is left of two that meet."""

from collections.abc import Sequence

from nas_data.hardware.virtual_bus.chain import Reply

BITS = 10  # of a byte on the wire: start, eight, stop


def seconds(count: int, baud: int) -> float:
    """Return the time that some bytes take [s]."""
    return count * BITS / baud


def transmit(replies: Sequence[Reply], baud: int) -> list[tuple[float, bytes]]:
    """Put replies on the wire.

    Args:
        replies: In the order in which the servos send them.
        baud: Speed of the line [bit/s].

    Returns:
        When each stretch of bytes has passed, in seconds after the end of the instruction, and the bytes.
    """
    sent: list[tuple[float, bytes]] = []
    for group in _turns(replies):
        begin = sent[-1][0] if sent else 0.0
        for place, reply in enumerate(sorted(group, key=lambda reply: reply.pause)):
            end = begin + reply.pause + seconds(len(reply.content), baud)
            if place and begin + reply.pause < sent[-1][0]:  # the other is still speaking
                sent[-1] = (max(end, sent[-1][0]), collide(sent[-1][1], reply.content))
            else:
                sent.append((end, reply.content))
    return sent


def _turns(replies: Sequence[Reply]) -> list[list[Reply]]:
    """Group replies that start to count their return delay at the same moment."""
    turns: list[list[Reply]] = []
    for reply in replies:
        if reply.together and turns:
            turns[-1].append(reply)
        else:
            turns.append([reply])
    return turns


def collide(first: bytes, second: bytes) -> bytes:
    """Return what two senders at once leave: a line that either pulls low is low."""
    longer = max(first, second, key=len)
    return bytes(a & b for a, b in zip(first, second, strict=False)) + longer[min(len(first), len(second)) :]
