"""A virtual arm on a half-duplex line: receives bytes, advances its simulation, returns timed replies."""

import time
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.chain import Reply
from nas_data.hardware.virtual_bus.faults import Fault
from nas_data.hardware.virtual_bus.packet import Instruction, Packet, PacketProtocol


class BusClock(Protocol):
    """Interface of a clock of a simulated arm."""

    def now(self) -> float:
        """Return the time since the start [s]."""

    def observe(self, packet: Packet) -> None:
        """Process a received instruction."""


class RealClock:
    """The monotonic clock."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def now(self) -> float:
        """Return the time since the start [s]."""
        return time.monotonic() - self._began

    def observe(self, packet: Packet) -> None:
        """Do nothing: time passes by itself."""


class LockStep:
    """Lock-step time: each goal sent to all servos advances it by a control period. For tests without waiting."""

    def __init__(self, protocol: PacketProtocol, goal: int, period: float) -> None:
        """Start at zero; a period [s] passes between two writes to the address of the goal register."""
        self._protocol, self._goal, self._period = protocol, goal, period
        self._time = 0.0

    def now(self) -> float:
        """Return the time since the start [s]."""
        return self._time

    def observe(self, packet: Packet) -> None:
        """Advance by a period if the packet sends goals."""
        if packet.instruction == Instruction.SYNC_WRITE and self._protocol.number(packet.parameters, 0) == self._goal:
            self._time += self._period


BITS = 10  # bits per byte on the wire: start bit, eight data bits, stop bit

SILENCE = 0.002  # [s] pause after which an incomplete packet is dropped


class Device:
    """A virtual arm with its faults."""

    def __init__(
        self,
        arm: VirtualArm,
        clock: BusClock,
        faults: Sequence[Fault],
        rng: np.random.Generator,
        wire_delay: bool = True,
    ) -> None:
        """Connect the arm to a line.

        Args:
            arm: Servos and body.
            clock: Clock of the simulation.
            faults: Faults to apply.
            rng: Random generator of the faults.
            wire_delay: Whether replies are delayed by the transmission time of bytes.
        """
        self.arm, self.clock = arm, clock
        self._rng, self._wire_delay = rng, wire_delay
        self._pending, self._active = list(faults), list[Fault]()
        self._reader = arm.kind.protocol.reader()
        self._last_received = 0.0
        self.disturbed = 0  # instructions and replies that faults changed or delayed

    def inject(self, fault: Fault) -> None:
        """Add a fault; it acts at once if its time has passed."""
        self._pending.append(fault)

    def repair(self) -> None:
        """End the faults that disturb the line."""
        self._active.clear()

    def advance(self) -> None:
        """Advance the simulation to the present time, and apply due faults.

        Raises:
            LineGone: a fault disconnects the adapter.
        """
        now = self.clock.now()
        self.arm.body.advance_to(now)
        for fault in [fault for fault in self._pending if fault.after <= now]:
            self._pending.remove(fault)
            self._active.append(fault)
            fault.apply(self.arm)

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """Process bytes received at a monotonic time [s]; bytes after a pause begin a new packet.

        Returns:
            Delay from now [s] and bytes of each reply, in ascending order of the delays.
        """
        if now - self._last_received > SILENCE:
            self._reader.forget()
        self._last_received = now
        sent = data
        for fault in self._active:
            data = fault.instruction(data, self._rng)
        self.disturbed += data != sent
        spent, replies = 0.0, list[tuple[float, bytes]]()
        for packet in self._reader.feed(data):
            spent += compute_transmission_time(len(packet.encode()), self._baud) if self._wire_delay else 0.0
            answers = self._answer(packet)
            replies += [(spent + after, content) for after, content in answers]
            spent = replies[-1][0] if answers else spent
        return replies

    def _answer(self, packet: Packet) -> list[tuple[float, bytes]]:
        self.advance()
        sent = transmit(self.arm.chain.respond(packet), self._baud)
        self.clock.observe(packet)  # afterwards, so that lock-step time advances with the new goal
        replies = [(after * self._wire_delay, content) for after, content in sent]
        late = sum(fault.delay(self._rng) for fault in self._active) if replies else 0.0
        sound = replies
        for fault in self._active:
            replies = [(after, fault.reply(content, self._rng)) for after, content in replies]
        self.disturbed += sum(one != other for one, other in zip(replies, sound, strict=True)) or late > 0
        return [(after + late, content) for after, content in replies]

    @property
    def _baud(self) -> int:
        return self.arm.kind.baud[self.arm.servos[0].get("baud_rate")]


def compute_transmission_time(count: int, baud: int) -> float:
    """Return the transmission time of `count` bytes [s] at a baud rate [bit/s]."""
    return count * BITS / baud


def transmit(replies: Sequence[Reply], baud: int) -> list[tuple[float, bytes]]:
    """Transmit replies, in the order in which the servos send them, at a baud rate [bit/s].

    Returns:
        Time of the last byte after the end of the instruction [s], and bytes, of each transmission.
    """
    sent: list[tuple[float, bytes]] = []
    for group in _group_replies(replies):
        begin = sent[-1][0] if sent else 0.0
        for index, reply in enumerate(sorted(group, key=lambda reply: reply.pause)):
            end = begin + reply.pause + compute_transmission_time(len(reply.content), baud)
            if index and begin + reply.pause < sent[-1][0]:  # the other servo is still sending
                sent[-1] = (max(end, sent[-1][0]), collide(sent[-1][1], reply.content))
            else:
                sent.append((end, reply.content))
    return sent


def _group_replies(replies: Sequence[Reply]) -> list[list[Reply]]:
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
