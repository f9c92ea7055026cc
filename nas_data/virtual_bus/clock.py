"""By which clock a simulated arm moves: the monotonic one, or in step with the goals that it is sent."""

import time
from typing import Protocol

from nas_data.virtual_bus.packet import Instruction, Packet
from nas_data.xl320.control_table import REGISTERS

PERIOD = 0.01  # [s] between two goals in lock-step: the paper's 100 Hz


class Clock(Protocol):
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

    def __init__(self) -> None:
        self._time = 0.0

    def now(self) -> float:
        """Return the time since the start [s]."""
        return self._time

    def heard(self, packet: Packet) -> None:
        """Advance by a period where goals were sent."""
        goal = REGISTERS["goal_position"].address
        if packet.instruction == Instruction.SYNC_WRITE and packet.parameters[:1] == bytes([goal]):
            self._time += PERIOD
