"""A line of servos through their maker's SDK: each read is whole, of the servo that was asked and fresh, or fails.

ROBOTIS' and Feetech's SDKs have the same classes. Both take a reply that comes too late for that to the next question,
so that the line is left alone after each failure until it has fallen silent.
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
from nas_data.hardware.arms.port_errors import busy, lost_port_error, refusal
from nas_data.hardware.arms.safety import OPENER

ATTEMPTS = 3
QUIET = 0.04  # [s] of silence after which nothing late is expected any more
LONGEST = 0.5  # [s] that silence is waited for
LISTENING = 5.0  # [ms] in which a second servo of the same identity would answer as well
PSEUDO_TERMINALS = "/dev/pts/"
LENIENCE = 150.0  # [ms] to wait longer where another program plays the servos: it must first be given a processor
LOOK = 0.002  # [s] that one look for its bytes may last, so that it is left the processor
SUCCESS = 0  # what both SDKs call COMM_SUCCESS


@dataclass(frozen=True)
class Register:
    """A place in the control table.

    Attributes:
        address: First byte.
        size: Bytes, little endian.
        sign: Bit that says minus; −1 for a two's complement, None for a number that is never negative.
    """

    address: int
    size: int
    sign: int | None = None

    def decode(self, data: Sequence[int], start: int = 0) -> int:
        """Return the register's value from bytes that begin at an address."""
        return self.signed(int.from_bytes(bytes(data[self.address - start :][: self.size]), "little"))

    def signed(self, value: int) -> int:
        """Return what bits, taken for a number without sign, say."""
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
            raise ServoRefused(f"{value} cannot be sent to a servo: {self.size} bytes do not hold it.")
        return list(bits.to_bytes(self.size, "little"))


@dataclass(frozen=True)
class StopRegisters:
    """The registers by which an arm is stopped.

    Attributes:
        sdk: Name of the SDK's package.
        protocol: Version of the protocol, as the SDK counts.
        baud: Speed of the line [bit/s].
        speed_unit: Of a unit of speed [rad/s].
        torque: Whether the torque is on.
        goal: Where the servo shall go.
        position: Where it is.
        speed: How fast it turns.
    """

    sdk: str
    protocol: float
    baud: int
    speed_unit: float
    torque: Register
    goal: Register
    position: Register
    speed: Register

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Read what `asdict` made."""
        kinds: dict[str, Any] = {
            key: Register(**value) if isinstance(value, Mapping) else value for key, value in values.items()
        }
        return cls(**kinds)


class Line:
    """Servos on an open port; see `Stoppable` for what it does to them.

    Attributes:
        port: The SDK's port.
        ids: Of the servos.
        failures: Exchanges that failed.
    """

    def __init__(self, table: StopRegisters, ids: Sequence[int], port: Any, packets: Any) -> None:
        """Take a port over that is open.

        Args:
            table: Registers.
            ids: Of the servos.
            port: The SDK's port.
            packets: The SDK's handler of packets.

        Raises:
            PortBusy: another program has it.
        """
        self.table, self.ids, self.port, self.failures = table, tuple(ids), port, 0
        self._packets, self._sdk = packets, importlib.import_module(table.sdk)
        try:
            port.ser.exclusive = True
        except OSError:
            port.closePort()
            raise busy(port.port_name) from None
        if port.port_name.startswith(PSEUDO_TERMINALS):
            _be_lenient(port)

    def read(self, identity: int, register: Register) -> int:
        """Return a register; raises as `read_bytes` does."""
        return register.decode(self.read_bytes(identity, register.address, register.size), register.address)

    def read_bytes(self, identity: int, address: int, length: int) -> bytes:
        """Return a stretch of a servo's memory.

        Raises:
            ServoSilent, BadReply: it does not answer, or not in a way that can be trusted.
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
                "one identity."
            )
        raise ServoSilent(f"Servo {identity} does not answer; check its plug and the plugs before it in the chain.")

    def read_all(self, address: int, length: int) -> list[bytes] | None:
        """Return a stretch of every servo's memory in one exchange; None where one is missing.

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
        """Write a register and make sure that it holds the value.

        Raises:
            ServoRefused: the servo keeps its own.
            ServoSilent, BadReply: it does not answer.
            AdapterLost: the port is gone.
        """
        data = register.encode(value)
        for _ in range(ATTEMPTS):
            with self._using():
                _, _ = self._packets.writeTxRx(self.port, identity, register.address, register.size, data)
            if self.read(identity, register) == value:
                return
        raise ServoRefused(f"Servo {identity} refuses {value} for address {register.address}; it keeps its own value.")

    def write_all(self, register: Register, values: Sequence[int]) -> None:
        """Write a register of every servo in one packet, which none of them confirms.

        Raises:
            AdapterLost: the port is gone.
        """
        group = self._sdk.GroupSyncWrite(self.port, self._packets, register.address, register.size)
        for identity, value in zip(self.ids, values, strict=True):
            group.addParam(identity, register.encode(int(value)))
        with self._using():
            group.txPacket()

    def ping(self, identity: int) -> int | None:
        """Return the model number of a servo; None where it does not answer."""
        for _ in range(ATTEMPTS):
            with self._using():
                model, result, _ = self._packets.ping(self.port, identity)
                if result == SUCCESS:
                    return int(model)
                self.calm()
        return None

    def voices(self, identity: int, address: int, length: int) -> tuple[int, bool]:
        """Ask one servo, and listen to everything that comes.

        Returns:
            How many sound replies of that identity came, and whether something unsound came.
        """
        newer = self.table.protocol >= 2
        fast, who = ((False,), 4) if newer else ((), 2)  # how the SDKs receive, and where a packet says who speaks
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

    def where(self) -> np.ndarray:
        """Return the positions as the servos count them, shape (n,); raises as `read` does."""
        return np.array([self.read(identity, self.table.position) for identity in self.ids])

    def stay(self, there: np.ndarray) -> None:
        """Command positions as the servos count them, shape (n,)."""
        self.write_all(self.table.goal, there.tolist())

    def speed(self) -> float:
        """Return the speed of the fastest servo [rad/s]; raises as `read` does."""
        return max(abs(self.read(identity, self.table.speed)) for identity in self.ids) * self.table.speed_unit

    def torque_off(self) -> None:
        """Switch the torque off at once, whatever moves; raises AdapterLost where the port is gone."""
        for _ in range(ATTEMPTS):  # nobody confirms it, and it must not get lost
            self.write_all(self.table.torque, [0] * len(self.ids))

    def unsure(self) -> list[int]:
        """Return the servos that do not confirm that their torque is off."""
        return [identity for identity in self.ids if not self._is_off(identity)]

    def close(self) -> None:
        """Give the port back."""
        self.port.closePort()

    def _is_off(self, identity: int) -> bool:
        try:
            return self.read(identity, self.table.torque) == 0
        except ArmError:
            return False

    def calm(self) -> None:
        """Wait until the line is silent: what comes late must not be taken for what is asked next."""
        self.failures += 1
        until, silent = time.monotonic() + LONGEST, time.monotonic() + QUIET
        while time.monotonic() < min(until, silent):
            if self.port.ser.in_waiting:
                self.port.ser.reset_input_buffer()
                silent = time.monotonic() + QUIET
            time.sleep(0.002)

    @contextmanager
    def _using(self) -> Iterator[None]:
        """Begin an exchange on a line from which nothing waits; say it where the port is gone."""
        with report_lost_port(self.port.port_name):
            self.port.is_using = False
            self.port.ser.reset_input_buffer()
            yield


def _be_lenient(port: Any) -> None:
    """Let a port wait longer for a packet, and sleep while it waits."""
    usual = port.setPacketTimeout

    def wait_longer(length: int) -> None:
        usual(length)
        port.packet_timeout += LENIENCE

    port.setPacketTimeout, port.ser.timeout = wait_longer, LOOK


@contextmanager
def report_lost_port(path: str) -> Iterator[None]:
    """Say in a sentence that the port is gone.

    Raises:
        AdapterLost: it is.
    """
    try:
        yield
    except ArmError:
        raise
    except (OSError, termios.error, TypeError) as error:  # a port that was closed meanwhile has no descriptor
        if isinstance(error, ConnectionError) and error.errno not in {errno.EIO, errno.ENODEV}:
            raise  # LeRobot's word for a servo that does not answer
        raise lost_port_error(path) from error


def charge(table: StopRegisters, ids: Sequence[int], port: str) -> dict[str, object]:
    """Return what a guard needs in order to stop the servos on a port."""
    return {OPENER: f"{__name__}:{open_line.__name__}", "table": asdict(table), "ids": list(ids), "port": port}


def open_line(table: Mapping[str, Any], ids: Sequence[int], port: str) -> Line:
    """Open a port in order to stop its servos; see `charge`.

    Raises:
        ArmError: it cannot be opened.
    """
    known = StopRegisters.from_json(table)
    sdk = importlib.import_module(known.sdk)
    handler = sdk.PortHandler(port)
    try:
        handler.setBaudRate(known.baud)
    except (OSError, ValueError) as error:
        raise refusal(port, error) from None
    return Line(known, ids, handler, sdk.PacketHandler(known.protocol))
