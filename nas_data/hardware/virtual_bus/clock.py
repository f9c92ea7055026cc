"""By which clock a simulated arm moves: the monotonic one, or in step with the goals that it is sent."""

import time
from typing import Protocol

from nas_data.hardware.virtual_bus.packet import Instruction, Packet
from nas_data.hardware.virtual_bus.protocols import PacketProtocol as Speech


class BusClock(Protocol):
    """What says how far the arm has moved."""

    def now(self) -> float:
        """Return the time since the start [s]."""

    def heard(self, packet: Packet) -> None:
        """Take note of an instruction."""


class RealClock:
    """The monotonic clock."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def now(self) -> float:
        """Return the time since the start [s]."""
        return time.monotonic() - self._began

    def heard(self, packet: Packet) -> None:
        """Time passes by itself."""


class LockStep:
    """Time that passes only when goals are sent to all servos, a control period each: for tests without waiting."""

    def __init__(self, speech: Speech, goal: int, period: float) -> None:
        """Stand at zero.

        Args:
            speech: How the servos speak.
            goal: Address of the goals.
            period: Between two goals [s].
        """
        self._speech, self._goal, self._period = speech, goal, period
        self._time = 0.0

    def now(self) -> float:
        """Return the time since the start [s]."""
        return self._time

    def heard(self, packet: Packet) -> None:
        """Advance by a period where goals were sent."""
        if packet.instruction == Instruction.SYNC_WRITE and self._speech.number(packet.parameters, 0) == self._goal:
            self._time += self._period
