"""Clocks of a simulated arm: real time, or lock-step with the received goals."""

import time
from typing import Protocol

from nas_data.hardware.virtual_bus.packet import Instruction, Packet
from nas_data.hardware.virtual_bus.protocols import PacketProtocol


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
        """Start at zero.

        Args:
            protocol: Packet protocol of the servos.
            goal: Address of the goal register.
            period: Time between two goals [s].
        """
        self._protocol, self._goal, self._period = protocol, goal, period
        self._time = 0.0

    def now(self) -> float:
        """Return the time since the start [s]."""
        return self._time

    def observe(self, packet: Packet) -> None:
        """Advance by a period if the packet sends goals."""
        if packet.instruction == Instruction.SYNC_WRITE and self._protocol.number(packet.parameters, 0) == self._goal:
            self._time += self._period
