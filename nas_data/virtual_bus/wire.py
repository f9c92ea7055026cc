"""What a half-duplex line makes of replies: when each byte has passed, and what is left of two that meet."""

from collections.abc import Sequence

from nas_data.virtual_bus.chain import Reply

BITS = 10  # of a byte on the wire: start, eight, stop
BAUD = {0: 9600, 1: 57_600, 2: 115_200, 3: 1_000_000}  # [bit/s] by the register; XL-320 e-manual


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
    clock = previous = 0.0  # end and begin of what was sent last
    for reply in replies:
        length = seconds(len(reply.content), baud)
        if not reply.together or not sent:
            previous = clock
            clock += reply.pause + length
            sent.append((clock, reply.content))
        elif previous + reply.pause >= clock:  # the other had another return delay and is through
            clock = previous + reply.pause + length
            sent.append((clock, reply.content))
        else:
            clock = max(clock, previous + reply.pause + length)
            sent[-1] = (clock, collide(sent[-1][1], reply.content))
    return sent


def collide(first: bytes, second: bytes) -> bytes:
    """Return what two senders at once leave: a line that either pulls low is low."""
    longer = max(first, second, key=len)
    return bytes(a & b for a, b in zip(first, second, strict=False)) + longer[min(len(first), len(second)) :]
