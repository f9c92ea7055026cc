"""A bus of servos through their maker's SDK: a read returns a complete, fresh reply of the right servo, or fails.

ROBOTIS' and Feetech's SDKs have the same classes. Both mistake a late reply for the reply to the next request.
Therefore the bus is left alone after each failure until it is silent.
"""

import errno
import importlib
import termios
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from nas_data.errors import ArmError, BadReply, ServoRefused, ServoSilent
from nas_data.hardware.arms.base import ArmOpener
from nas_data.hardware.arms.port_errors import make_busy_error, make_lost_port_error, make_port_error

ATTEMPTS = 3
QUIET = 0.04  # [s] of silence after which no late reply is expected
LONGEST = 0.5  # [s] to wait for silence
LISTENING = 5.0  # [ms] in which a second servo with the same ID would answer as well
PSEUDO_TERMINALS = "/dev/pts/"
LENIENCE = 0.15  # [s] of extra timeout for virtual servos: their process must first be scheduled
POLL_TIMEOUT = 0.002  # [s] read timeout with virtual servos; blocking leaves the processor to their process
SUCCESS = 0  # COMM_SUCCESS of both SDKs


@dataclass(frozen=True)
class Register:
    """A register in the control table."""

    address: int  # first byte
    size: int  # bytes, little endian
    sign: int | None = None  # sign bit of a sign-magnitude number; −1 for two's complement, None if unsigned

    def decode(self, data: Sequence[int], start: int = 0) -> int:
        """Return the value from bytes that begin at address `start`."""
        return self.signed(int.from_bytes(bytes(data[self.address - start :][: self.size]), "little"))

    def signed(self, value: int) -> int:
        """Convert an unsigned number to the signed value."""
        if self.sign is None:
            return value
        if self.sign < 0:
            return value - 256**self.size if value >> (8 * self.size - 1) else value
        size = value & ((1 << self.sign) - 1)
        return -size if value >> self.sign & 1 else size

    def encode(self, value: int) -> list[int]:
        """Return the bytes of a value.

        Raises:
            ServoRefused: the register cannot hold it.
        """
        bits = value if value >= 0 else (256**self.size + value if self.sign == -1 else -value | 1 << (self.sign or 0))
        if self.signed(bits) != value or bits >= 256**self.size:
            raise ServoRefused(f"{value} cannot be sent to a servo: it does not fit into {self.size} bytes.")
        return list(bits.to_bytes(self.size, "little"))


@dataclass(frozen=True)
class StopRegisters:
    """The registers that are needed to stop an arm."""

    sdk: str  # name of the SDK's package
    protocol: float  # protocol version, as the SDK counts
    baud: int  # baud rate [bit/s]
    speed_unit: float  # unit of the speed register [rad/s]
    torque: Register  # torque enable register
    goal: Register  # goal position register
    position: Register  # present position register
    speed: Register  # present speed register

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Read the output of `asdict`."""
        kinds: dict[str, Any] = {
            key: Register(**value) if isinstance(value, Mapping) else value for key, value in values.items()
        }
        return cls(**kinds)


class Line:
    """Servos on an open port; implements `Stoppable`."""

    def __init__(self, table: StopRegisters, ids: Sequence[int], port: Any, packets: Any) -> None:
        """Take over an open port.

        Raises:
            PortBusy: another program uses the port.
        """
        self.table, self.ids, self.port, self.failures = table, tuple(ids), port, 0
        self._packets, self._sdk = packets, importlib.import_module(table.sdk)
        try:
            port.ser.exclusive = True
        except OSError:
            port.closePort()
            raise make_busy_error(port.port_name) from None
        if port.port_name.startswith(PSEUDO_TERMINALS):
            _extend_timeout(port)

    def read(self, identity: int, register: Register) -> int:
        """Return the value of a register; raises like `read_bytes`."""
        return register.decode(self.read_bytes(identity, register.address, register.size), register.address)

    def read_bytes(self, identity: int, address: int, length: int) -> bytes:
        """Return a range of a servo's memory.

        Raises:
            ServoSilent: the servo does not answer.
            BadReply: its replies are damaged.
            AdapterLost: the port is gone.
        """
        for _ in range(ATTEMPTS):
            with self._using():
                data, result, _ = self._packets.readTxRx(self.port, identity, address, length)
                if result == SUCCESS and len(data) == length:
                    return bytes(data)
                self.calm()
        if self.ping(identity):
            raise BadReply(
                f"Servo {identity} answers, but not reliably; check its plugs, the supply, and that no two servos have "
                "the same ID."
            )
        raise ServoSilent(f"Servo {identity} does not answer; check its plug and the plugs before it in the chain.")

    def read_all(self, address: int, length: int) -> list[bytes] | None:
        """Return a range of every servo's memory in one transaction; None if a reply is missing.

        Raises:
            AdapterLost: the port is gone.
        """
        with self._using():
            group = self._sdk.GroupSyncRead(self.port, self._packets, address, length)
            for identity in self.ids:
                group.addParam(identity)
            result = group.txRxPacket()
            answers = [bytes(group.data_dict[identity] or ()) for identity in self.ids]
            if result == SUCCESS and all(len(answer) == length for answer in answers):
                return answers
            self.calm()
        return None

    def write(self, identity: int, register: Register, value: int) -> None:
        """Write a register, and verify it by reading it back.

        Raises:
            ServoRefused: the servo keeps another value.
            ServoSilent, BadReply: it does not answer reliably.
            AdapterLost: the port is gone.
        """
        data = register.encode(value)
        for _ in range(ATTEMPTS):
            with self._using():
                _, _ = self._packets.writeTxRx(self.port, identity, register.address, register.size, data)
            if self.read(identity, register) == value:
                return
        raise ServoRefused(
            f"Servo {identity} refuses {value} for address {register.address}; its old value is unchanged."
        )

    def write_all(self, register: Register, values: Sequence[int]) -> None:
        """Write a register of every servo in one packet, without confirmation.

        Raises:
            AdapterLost: the port is gone.
        """
        group = self._sdk.GroupSyncWrite(self.port, self._packets, register.address, register.size)
        for identity, value in zip(self.ids, values, strict=True):
            group.addParam(identity, register.encode(int(value)))
        with self._using():
            group.txPacket()

    def ping(self, identity: int) -> int | None:
        """Return the model number of a servo; None if it does not answer."""
        for _ in range(ATTEMPTS):
            with self._using():
                model, result, _ = self._packets.ping(self.port, identity)
                if result == SUCCESS:
                    return int(model)
                self.calm()
        return None

    def count_replies(self, identity: int, address: int, length: int) -> tuple[int, bool]:
        """Send a read request to one ID, and count all replies; two servos with one ID both answer.

        Returns:
            Number of valid replies, and whether a damaged one came.
        """
        newer = self.table.protocol >= 2
        fast, who = ((False,), 4) if newer else ((), 2)  # arguments of rxPacket, and index of the ID in a packet
        with self._using():
            self._packets.readTx(self.port, identity, address, length)
            sound, damaged = 0, False
            while True:
                packet, result = self._packets.rxPacket(self.port, *fast)
                if result != SUCCESS:
                    return sound, damaged or bool(packet)
                sound += packet[who] == identity
                damaged |= packet[who] != identity
                self.port.setPacketTimeoutMillis(LISTENING)

    def read_position(self) -> np.ndarray:
        """Return the present positions [counts], shape (n,); raises like `read`."""
        return np.array([self.read(identity, self.table.position) for identity in self.ids])

    def hold(self, position: np.ndarray) -> None:
        """Command positions [counts], shape (n,)."""
        self.write_all(self.table.goal, position.tolist())

    def speed(self) -> float:
        """Return the speed of the fastest servo [rad/s]; raises like `read`."""
        return max(abs(self.read(identity, self.table.speed)) for identity in self.ids) * self.table.speed_unit

    def torque_off(self) -> None:
        """Switch the torque off at once, even in motion; raises AdapterLost if the port is gone."""
        for _ in range(ATTEMPTS):  # the packet is not confirmed, and must not get lost
            self.write_all(self.table.torque, [0] * len(self.ids))

    def find_unconfirmed(self) -> list[int]:
        """Return the IDs of servos that do not confirm that their torque is off."""
        return [identity for identity in self.ids if not self._is_off(identity)]

    def close(self) -> None:
        """Close the port."""
        self.port.closePort()

    def _is_off(self, identity: int) -> bool:
        try:
            return self.read(identity, self.table.torque) == 0
        except ArmError:
            return False

    def calm(self) -> None:
        """Wait until the bus is silent: a late reply must not be taken for the next one."""
        self.failures += 1
        until, silent = time.monotonic() + LONGEST, time.monotonic() + QUIET
        while time.monotonic() < min(until, silent):
            if self.port.ser.in_waiting:
                self.port.ser.reset_input_buffer()
                silent = time.monotonic() + QUIET
            time.sleep(0.002)

    @contextmanager
    def _using(self) -> Iterator[None]:
        """Begin a transaction with an empty input buffer; raise AdapterLost if the port is gone."""
        with report_lost_port(self.port.port_name):
            self.port.is_using = False
            self.port.ser.reset_input_buffer()
            yield


def _extend_timeout(port: Any) -> None:
    """Extend the timeout of a port, and let it sleep while it waits."""
    usual = port.setPacketTimeout

    def wait_longer(length: int) -> None:
        usual(length)
        port.packet_timeout += LENIENCE * 1e3

    port.setPacketTimeout, port.ser.timeout = wait_longer, POLL_TIMEOUT


@contextmanager
def report_lost_port(path: str) -> Iterator[None]:
    """Translate the errors of a vanished port.

    Raises:
        AdapterLost: the port is gone.
    """
    try:
        yield
    except ArmError:
        raise
    except (OSError, termios.error, TypeError) as error:  # a closed port has no descriptor
        if isinstance(error, ConnectionError) and error.errno not in {errno.EIO, errno.ENODEV}:
            raise  # LeRobot raises it for a servo that does not answer
        raise make_lost_port_error(path) from error


def make_line_opener(table: StopRegisters, ids: Sequence[int], port: str) -> ArmOpener:
    """Return how the watchdog opens a port to stop its servos; see `open_line`."""
    arguments = {"table": asdict(table), "ids": list(ids), "port": port}
    return ArmOpener(f"{__name__}:{open_line.__name__}", arguments)


def open_line(table: Mapping[str, Any], ids: Sequence[int], port: str) -> Line:
    """Open a port in order to stop its servos; see `make_line_opener`.

    Raises:
        ArmError: the port cannot be opened.
    """
    known = StopRegisters.from_json(table)
    sdk = importlib.import_module(known.sdk)
    handler = sdk.PortHandler(port)
    try:
        handler.setBaudRate(known.baud)
    except (OSError, ValueError) as error:
        raise make_port_error(port, error) from None
    return Line(known, ids, handler, sdk.PacketHandler(known.protocol))
