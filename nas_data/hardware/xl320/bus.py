"""Reads and writes of XL-320 registers through an exclusive port: a read returns a complete, fresh reply, or fails."""

import termios
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import serial
from dynamixel_sdk import COMM_SUCCESS, GroupSyncWrite, PacketHandler, PortHandler

from nas_data.errors import BadReply, ServoRefused, ServoSilent
from nas_data.hardware.arms.line import LENIENCE, PSEUDO_TERMINALS
from nas_data.hardware.arms.port_errors import make_lost_port_error, make_port_error
from nas_data.hardware.xl320.control_table import REGISTERS

BAUD = 1_000_000  # [bit/s] factory setting of an XL-320
PATIENCE = 0.02  # [s] timeout of a reply in addition to its transmission time; USB latency timers take up to 16 ms
WAIT = 0.002  # [s] read timeout
WRITING = 0.2  # [s] write timeout
VIRTUAL_WRITING = 1.0  # [s] the same with virtual servos: on a busy machine, their process may be scheduled late


class Port(PortHandler):
    """The SDK's port with blocking reads instead of busy waiting, and a monotonic clock."""

    patience = PATIENCE
    is_open: bool = False

    def setupPort(self, cflag_baud: int) -> bool:  # noqa: N802  # the SDK's name
        """Open the port; see `open_port` for the errors."""
        if self.is_open:
            self.closePort()
        writing = VIRTUAL_WRITING if self.port_name.startswith(PSEUDO_TERMINALS) else WRITING
        self.ser = serial.Serial(self.port_name, cflag_baud, timeout=WAIT, write_timeout=writing, exclusive=True)
        self.is_open = True
        self.tx_time_per_byte = 1e4 / cflag_baud  # [ms]
        return True

    def getCurrentTime(self) -> float:  # noqa: N802
        """Return the monotonic time [ms]."""
        return time.monotonic() * 1e3

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start the timeout for a packet of `packet_length` bytes."""
        self.setPacketTimeoutMillis(packet_length * self.tx_time_per_byte + self.patience * 1e3)

    def drain(self) -> None:
        """Discard received bytes."""
        self.ser.reset_input_buffer()


def open_port(path: str, baud: int = BAUD) -> Port:
    """Open a serial port.

    Raises:
        NoSuchPort: there is no such port.
        PortDenied: the user has no permission.
        PortBusy: another program uses the port.
        ArmError: it is no serial port.
    """
    port = Port(path)
    port.patience = LENIENCE if path.startswith(PSEUDO_TERMINALS) else PATIENCE
    try:
        port.setBaudRate(baud)
    except (OSError, ValueError) as error:
        raise make_port_error(path, error) from None
    return port


ATTEMPTS = 3
WRAPPING = 4  # bytes of instruction, error and checksum, which the length of a reply includes
ERROR_INDEX, DATA_INDEX = 8, 9  # in a status packet
ALERT = 0x80  # bit of a reply's error: the servo has a hardware error
LENGTHS = 3  # different lengths of a read: up to two additional bytes
LISTENING = 0.005  # [s] in which a second servo with the same ID would answer as well
PROTOCOL = 2.0
REASONS = {
    1: "it could not follow the instruction",
    2: "it does not know the instruction",
    3: "the instruction arrived damaged",
    4: "the value is out of the register's range",
    5: "the value has the wrong length",
    6: "the value is beyond a limit",
    7: "the register is read-only, or locked while the torque is on",
}


@dataclass(frozen=True)
class Answer:
    """Reply of a servo."""

    data: bytes  # bytes that were read
    alert: bool  # whether the servo has a hardware error

    def register(self, name: str, start: int) -> int:
        """Return a register's value from data that begin at address `start`."""
        entry = REGISTERS[name]
        return int.from_bytes(self.data[entry.address - start : entry.address - start + entry.size], "little")


class Bus:
    """The bus of the servos, through dynamixel-sdk.

    A late reply must not be taken for the reply to the next request. Therefore the length of reads changes after each
    failure, by up to two additional bytes: the length distinguishes an old reply from a new one.
    """

    def __init__(self, port: Port) -> None:
        self.port = port
        self.failures = 0
        self._handler = PacketHandler(PROTOCOL)

    def ping(self, identity: int) -> bool:
        """Return whether a servo answers."""
        with self._using():
            _, result, _ = self._handler.ping(self.port, identity)
        return bool(result == COMM_SUCCESS)

    def broadcast_ping(self) -> dict[int, int]:
        """Return the model number of each servo that answers a broadcast ping, by its ID; takes 0.8 s."""
        with self._using():
            servos, _ = self._handler.broadcastPing(self.port)
        return {identity: numbers[0] for identity, numbers in servos.items()}

    def read(self, identity: int, address: int, length: int, attempts: int = ATTEMPTS) -> Answer:
        """Return a range of a servo's memory.

        Raises:
            ServoSilent, BadReply: it does not answer, or not reliably.
            AdapterLost: the port is gone.
        """
        for attempt in range(attempts):
            requested = length + self._extra
            with self._using():
                sent = self._handler.readTx(self.port, identity, address, requested) == COMM_SUCCESS
                answer = self._receive(identity, length, requested) if sent else None
            if answer is not None:
                return answer
            self.failures += 1
            if attempt + 1 == attempts:
                self._raise_silence(identity)
        raise AssertionError("at least one attempt is made")

    def sync_read(self, identities: Sequence[int], address: int, length: int) -> list[Answer] | None:
        """Return a range of the memory of several servos by one sync read; None if a reply is missing.

        Raises:
            AdapterLost: the port is gone.
        """
        requested = length + self._extra
        answers = []
        with self._using():
            sent = self._handler.syncReadTx(self.port, address, requested, list(identities), len(identities), False)
            for identity in identities if sent == COMM_SUCCESS else ():
                answer = self._receive(identity, length, requested)
                if answer is None:
                    break
                answers.append(answer)
        if len(answers) == len(identities):
            return answers
        self.failures += 1
        return None

    def write(self, identity: int, name: str, value: int) -> None:
        """Write a register and verify it by reading it back.

        Raises:
            ServoRefused: the servo refuses the value.
            ServoSilent, BadReply: it does not answer.
            AdapterLost: the port is gone.
        """
        register = REGISTERS[name]
        data = list(value.to_bytes(register.size, "little"))
        error = 0
        for _ in range(ATTEMPTS):
            with self._using():
                _, error = self._handler.writeTxRx(self.port, identity, register.address, register.size, data)
            if self.get(identity, name) == value:
                return
        reason = REASONS.get(error & ~ALERT, "its old value is unchanged")
        raise ServoRefused(f"Servo {identity} refuses {value} for {name.replace('_', ' ')}: {reason}.")

    def get(self, identity: int, name: str) -> int:
        """Return a register's value; raises like `read`."""
        register = REGISTERS[name]
        return self.read(identity, register.address, register.size).register(name, register.address)

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Write a register of several servos in one packet, without confirmation.

        Raises:
            AdapterLost: the port is gone.
        """
        register = REGISTERS[name]
        group = GroupSyncWrite(self.port, self._handler, register.address, register.size)
        for identity, value in values.items():
            group.addParam(identity, list(value.to_bytes(register.size, "little")))
        with self._using():
            group.txPacket()

    def rename(self, identity: int, new: int) -> None:
        """Change the ID of a servo; its torque is off afterwards.

        Raises:
            ServoSilent: it does not answer with the old or the new ID.
            AdapterLost: the port is gone.
        """
        self.write(identity, "torque_enable", 0)
        register = REGISTERS["id"]
        with self._using():
            self._handler.writeTxRx(self.port, identity, register.address, register.size, [new])
        self.read(new, register.address, register.size)

    def reboot(self, identity: int) -> None:
        """Restart a servo, which clears its errors and its volatile registers."""
        with self._using():
            self._handler.reboot(self.port, identity)

    def count_replies(self, identity: int, address: int, length: int) -> tuple[int, bool]:
        """Send a read request to one ID, and count all replies; two servos with one ID both answer.

        Returns:
            Number of valid replies, and whether a damaged one came.
        """
        requested = length + self._extra
        with self._using():
            self._handler.readTx(self.port, identity, address, requested)
            sound, damaged = 0, False
            while True:
                packet, result = self._handler.rxPacket(self.port, False)
                if result != COMM_SUCCESS:
                    self.failures += sound != 1
                    return sound, damaged or bool(packet)
                sound += packet[4] == identity and packet[5] + 256 * packet[6] == requested + WRAPPING
                damaged |= packet[4] != identity
                self.port.setPacketTimeoutMillis(LISTENING * 1e3)

    @property
    def _extra(self) -> int:
        return self.failures % LENGTHS

    def _receive(self, identity: int, length: int, requested: int) -> Answer | None:
        """Wait for the reply of a servo; skip replies of other servos or lengths, which are old."""
        while True:
            packet, result = self._handler.rxPacket(self.port, False)
            if result != COMM_SUCCESS:
                return None
            if packet[4] == identity and packet[5] + 256 * packet[6] == requested + WRAPPING:
                error = packet[ERROR_INDEX]
                data = bytes(packet[DATA_INDEX : DATA_INDEX + length])
                return Answer(data, bool(error & ALERT)) if not error & ~ALERT else None

    def _raise_silence(self, identity: int) -> None:
        if self.ping(identity):
            raise BadReply(
                f"Servo {identity} answers, but not reliably; check its plugs, the supply, and that no two servos have "
                "the same ID."
            )
        raise ServoSilent(f"Servo {identity} does not answer; check its plug and the plugs before it in the chain.")

    @contextmanager
    def _using(self) -> Iterator[None]:
        """Begin a transaction with an empty input buffer; raise AdapterLost if the port is gone."""
        try:
            self.port.is_using = False
            self.port.drain()
            yield
        except (OSError, termios.error) as error:
            raise make_lost_port_error(self.port.port_name) from error
