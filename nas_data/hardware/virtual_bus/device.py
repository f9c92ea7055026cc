"""The arm behind its line: takes bytes in, moves, and says which bytes come back when."""

from collections.abc import Sequence

import numpy as np

from nas_data.hardware.virtual_bus.arm import VirtualArm
from nas_data.hardware.virtual_bus.clock import BusClock
from nas_data.hardware.virtual_bus.faults.base import Fault
from nas_data.hardware.virtual_bus.packet import Packet
from nas_data.hardware.virtual_bus.wire import seconds, transmit

SILENCE = 0.002  # [s] after which an unfinished packet is forgotten


class Device:
    """A virtual arm with its faults.

    Attributes:
        arm: Servos and body.
        clock: By which it moves.
    """

    def __init__(
        self, arm: VirtualArm, clock: BusClock, faults: Sequence[Fault], rng: np.random.Generator, honest: bool = True
    ) -> None:
        """Put the arm on a line.

        Args:
            arm: Servos and body.
            clock: By which it moves.
            faults: What goes wrong.
            rng: Decides which packets are hit.
            honest: Whether bytes take their time on the wire; none otherwise.
        """
        self.arm, self.clock = arm, clock
        self._rng, self._honest = rng, honest
        self._coming, self._active = list(faults), list[Fault]()
        self._reader = arm.kind.protocol.reader()
        self._heard = 0.0

    def inject(self, fault: Fault) -> None:
        """Let one more fault happen, at once where its time is past."""
        self._coming.append(fault)

    def repair(self) -> None:
        """End what disturbs the line."""
        self._active.clear()

    def live(self) -> None:
        """Let time pass.

        Raises:
            LineGone: a fault says so.
        """
        now = self.clock.now()
        self.arm.body.advance_to(now)
        for fault in [fault for fault in self._coming if fault.after <= now]:
            self._coming.remove(fault)
            self._active.append(fault)
            fault.strike(self.arm)

    def hear(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """Take bytes from the line.

        Args:
            data: What was sent.
            now: Monotonic time [s]: bytes after a pause begin a new packet.

        Returns:
            Seconds from now, ascending, and what the computer then hears.
        """
        if now - self._heard > SILENCE:
            self._reader.forget()
        self._heard = now
        for fault in self._active:
            data = fault.instruction(data, self._rng)
        spent, sent = 0.0, list[tuple[float, bytes]]()
        for packet in self._reader.feed(data):
            spent += seconds(len(packet.encode()), self._baud) if self._honest else 0.0
            answers = self._answer(packet)
            sent += [(spent + after, content) for after, content in answers]
            spent = sent[-1][0] if answers else spent
        return sent

    def _answer(self, packet: Packet) -> list[tuple[float, bytes]]:
        self.live()
        sent = transmit(self.arm.chain.respond(packet), self._baud)
        self.clock.heard(packet)  # afterwards: time that passes with a goal passes under this goal
        replies = [(after * self._honest, content) for after, content in sent]
        late = sum(fault.delay(self._rng) for fault in self._active) if replies else 0.0
        for fault in self._active:
            replies = [(after, fault.reply(content, self._rng)) for after, content in replies]
        return [(after + late, content) for after, content in replies]

    @property
    def _baud(self) -> int:
        return self.arm.kind.baud[self.arm.servos[0].get("baud_rate")]
