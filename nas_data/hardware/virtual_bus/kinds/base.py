"""Interface of servo series: control table, bus protocol, and the physics of the registers."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property
from typing import TYPE_CHECKING

from nas_data import registry
from nas_data.hardware.virtual_bus.packet import ALERT, PROTOCOL_2, Error, Instruction, PacketProtocol
from nas_data.hardware.xl320.control_table import ControlTableEntry

if TYPE_CHECKING:
    from nas_data.hardware.virtual_bus.servo import VirtualServo

ANSWERS_ALL = 2  # status level at which every instruction is answered; lower levels answer only some
LEVELS: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}
VOLT = 0.1  # [V] unit of every voltage register
OVERLOAD = (0.95, 2.0)  # share of the largest torque that counts as stalled, and tolerated duration [s]
STILL = 0.05  # [rad/s] below which a servo does not report motion


class Reason(IntFlag):
    """Reason for which a servo shuts down."""

    OVERLOAD = 1
    OVERHEAT = 2
    VOLTAGE = 4


@dataclass(frozen=True)
class ServoDrive:
    """Drive state of a servo, from its registers."""

    powered: bool  # whether its torque is on
    goal: int  # goal position [counts]
    speed: float = math.inf  # speed limit [rad/s]; infinite for none
    acceleration: float = math.inf  # acceleration limit [rad/s²]; infinite for none
    stiffness: float = 1.0  # gain relative to the model's
    strength: float = 1.0  # torque limit as a share of the largest torque
    deadband: float = 0.0  # position error that it ignores [rad]


@dataclass(frozen=True)
class ServoMeasurements:
    """Measurements of a servo."""

    position: int  # encoder position [counts]
    speed: float  # speed [rad/s], positive for rising counts
    effort: float  # share of its largest torque, with the same sign convention
    voltage: float  # [V]
    temperature: float  # [°C]

    @property
    def degrees_celsius(self) -> int:
        """The temperature as a register value, 0 … 255."""
        return max(0, min(255, round(self.temperature)))


@dataclass(frozen=True)
class Bounds:
    """Operating limits of a servo."""

    lowest: float  # lowest voltage [V]
    highest: float  # highest voltage [V]
    hottest: float  # highest temperature [°C]
    strain: float  # share of its largest torque that counts as stalled
    seconds: float  # duration of a stall after which it shuts down [s]


class ServoSeries(ABC):
    """A series of servos. It is stateless: the state of a servo is in its registers.

    Every table has the registers id, model_number, torque_enable, return_delay, status_level, baud_rate,
    goal_position, registered, moving and hardware_error.
    """

    registers: Mapping[str, ControlTableEntry]  # the control table by name
    tick: float  # angle of a unit of position [rad]
    supply: float  # usual voltage [V]
    stall_current: float  # stall current at that voltage [A]
    stall_torque: float  # stall torque at that voltage [N m]
    baud: Mapping[int, int]  # baud rate [bit/s] by register value
    bits: Mapping[Reason, int]  # bit of each reason in the registers hardware_error and shutdown
    unloads: str | None = None  # register that a shutdown sets to zero; None if there is none
    protocol: PacketProtocol = PROTOCOL_2  # packet protocol

    @cached_property
    def size(self) -> int:
        """Bytes of the control table."""
        return max(register.address + register.size for register in self.registers.values())

    @cached_property
    def by_address(self) -> dict[int, ControlTableEntry]:
        """The register of each address; other addresses read as zero."""
        return {r.address + k: r for r in self.registers.values() for k in range(r.size)}

    @abstractmethod
    def is_persistent(self, register: ControlTableEntry) -> bool:
        """Whether a register survives a loss of power."""

    @abstractmethod
    def drive(self, servo: "VirtualServo") -> ServoDrive:
        """Return the drive state that the registers define."""

    @abstractmethod
    def sense(self, servo: "VirtualServo", measured: ServoMeasurements) -> None:
        """Write measurements into the registers."""

    def overload(self, servo: "VirtualServo") -> tuple[float, float]:
        """Return the share of the largest torque that counts as stalled, and its tolerated duration [s]."""
        return OVERLOAD

    def bounds(self, servo: "VirtualServo") -> Bounds:
        """Return the operating limits of a servo."""
        lowest, highest = (servo.get(name) * VOLT for name in ("lowest_voltage", "highest_voltage"))
        return Bounds(lowest, highest, float(servo.get("temperature_limit")), *self.overload(servo))

    def fail(self, servo: "VirtualServo", reason: Reason) -> None:
        """Set a hardware error; a servo that shuts down switches its torque off."""
        bits = sum(self.bits[one] for one in reason)
        servo.put("hardware_error", servo.get("hardware_error") | bits)
        if self.unloads and servo.get("shutdown") & bits:
            servo.put(self.unloads, 0)

    def is_locked(self, servo: "VirtualServo", register: ControlTableEntry) -> bool:
        """Whether a register is locked: persistent registers are locked while the torque is on."""
        return self.is_persistent(register) and bool(servo.get("torque_enable"))

    def check_write(self, servo: "VirtualServo", register: ControlTableEntry, value: int) -> Error:
        """Return the error for a value that a register refuses although it is in range."""
        return Error.NONE

    def power_on(self, servo: "VirtualServo") -> None:  # noqa: B027  # many have nothing to do
        """Initialise registers at power-on."""

    def error_byte(self, servo: "VirtualServo", error: Error) -> int:
        """Return the error byte of a status packet."""
        return error | (ALERT if servo.get("hardware_error") else 0)

    def answers(self, servo: "VirtualServo", instruction: int) -> bool:
        """Whether a servo answers an instruction at its status level."""
        return servo.get("status_level") >= LEVELS.get(instruction, ANSWERS_ALL)


def make_register(
    name: str, address: int, size: int = 1, initial: int = 0, high: int | None = None
) -> ControlTableEntry:
    """Return a writable register, whose range is by default all values of its size."""
    return ControlTableEntry(name, address, size, initial, 0, 256**size - 1 if high is None else high)


def make_read_only(name: str, address: int, size: int = 1, initial: int = 0) -> ControlTableEntry:
    """Return a read-only register."""
    return ControlTableEntry(name, address, size, initial, 0, 256**size - 1, writable=False)


def find_kind(name: str) -> ServoSeries:
    """Return a series of servos by its name.

    Raises:
        UnknownName: there is no such series; the message lists the known ones.
    """
    kind: ServoSeries = registry.import_plugin("hardware.virtual_bus.kinds", name, "virtual servo").KIND
    return kind
