"""Reads and writes of XL-320 registers by dynamixel-sdk: each is whole, from the right servo and fresh, or fails."""

import termios
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from dynamixel_sdk import COMM_SUCCESS, GroupSyncWrite, PacketHandler

from nas_data.errors import BadReply, ServoRefused, ServoSilent
from nas_data.hardware.arms.port_errors import lost_port_error
from nas_data.hardware.xl320.control_table import REGISTERS
from nas_data.hardware.xl320.port import Port

ATTEMPTS = 3
WRAPPING = 4  # instruction, error and checksum: what a reply's length counts besides its data
ERROR_PLACE, DATA_PLACE = 8, 9  # in a status packet
ALERT = 0x80  # bit of a reply's error: the servo has a hardware error
LENGTHS = 3  # ways in which a read may be longer than needed
LISTENING = 0.005  # [s] in which a second servo of the same identity would answer as well
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
    """What a servo said.

    Attributes:
        data: What was asked for.
        alert: Whether it has a hardware error.
    """

    data: bytes
    alert: bool

    def register(self, name: str, start: int) -> int:
        """Return a register of data that begins at an address."""
        entry = REGISTERS[name]
        return int.from_bytes(self.data[entry.address - start : entry.address - start + entry.size], "little")


class Bus:
    """The line to the servos.

    A reply that comes too late must not be taken for that to the next question. Reads are therefore asked for with a
    byte or two more than needed after each failure: the length tells an old reply from a new one.
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
        """Return the model number of everything that answers a call to all, by its identity; takes 0.8 s."""
        with self._using():
            servos, _ = self._handler.broadcastPing(self.port)
        return {identity: numbers[0] for identity, numbers in servos.items()}

    def read(self, identity: int, address: int, length: int, attempts: int = ATTEMPTS) -> Answer:
        """Return a stretch of a servo's memory.

        Raises:
            ServoSilent, BadReply: it does not answer, or not in a way that can be trusted.
            AdapterLost: the port is gone.
        """
        for attempt in range(attempts):
            asked = length + self._extra
            with self._using():
                sent = self._handler.readTx(self.port, identity, address, asked) == COMM_SUCCESS
                answer = self._receive(identity, length, asked) if sent else None
            if answer is not None:
                return answer
            self.failures += 1
            if attempt + 1 == attempts:
                self._raise_silence(identity)
        raise AssertionError("at least one attempt is made")

    def sync_read(self, identities: Sequence[int], address: int, length: int) -> list[Answer] | None:
        """Return a stretch of the memory of several servos in one exchange; None where one is missing.

        Raises:
            AdapterLost: the port is gone.
        """
        asked = length + self._extra
        answers = []
        with self._using():
            sent = self._handler.syncReadTx(self.port, address, asked, list(identities), len(identities), False)
            for identity in identities if sent == COMM_SUCCESS else ():
                answer = self._receive(identity, length, asked)
                if answer is None:
                    break
                answers.append(answer)
        if len(answers) == len(identities):
            return answers
        self.failures += 1
        return None

    def write(self, identity: int, name: str, value: int) -> None:
        """Write a register and make sure that it holds the value.

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
        reason = REASONS.get(error & ~ALERT, "it keeps its own value")
        raise ServoRefused(f"Servo {identity} refuses {value} for {name.replace('_', ' ')}: {reason}.")

    def get(self, identity: int, name: str) -> int:
        """Return a register; raises as `read` does."""
        register = REGISTERS[name]
        return self.read(identity, register.address, register.size).register(name, register.address)

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Write a register of several servos in one packet, which none of them confirms.

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
        """Give a servo another identity; its torque is off afterwards.

        Raises:
            ServoSilent: it does not answer, or not by its new identity.
            AdapterLost: the port is gone.
        """
        self.write(identity, "torque_enable", 0)
        register = REGISTERS["id"]
        with self._using():
            self._handler.writeTxRx(self.port, identity, register.address, register.size, [new])
        self.read(new, register.address, register.size)

    def reboot(self, identity: int) -> None:
        """Let a servo start anew, which clears its errors; its memory in RAM is lost."""
        with self._using():
            self._handler.reboot(self.port, identity)

    def count_replies(self, identity: int, address: int, length: int) -> tuple[int, bool]:
        """Ask one servo and listen to everything that comes; a late reply to an earlier question has another length.

        Returns:
            How many sound replies of that identity came, and whether something unsound came.
        """
        asked = length + self._extra
        with self._using():
            self._handler.readTx(self.port, identity, address, asked)
            sound, damaged = 0, False
            while True:
                packet, result = self._handler.rxPacket(self.port, False)
                if result != COMM_SUCCESS:
                    self.failures += sound != 1
                    return sound, damaged or bool(packet)
                sound += packet[4] == identity and packet[5] + 256 * packet[6] == asked + WRAPPING
                damaged |= packet[4] != identity
                self.port.setPacketTimeoutMillis(LISTENING * 1e3)

    @property
    def _extra(self) -> int:
        return self.failures % LENGTHS

    def _receive(self, identity: int, length: int, asked: int) -> Answer | None:
        """Wait for the reply of a servo; replies of others and of another length are old and passed over."""
        while True:
            packet, result = self._handler.rxPacket(self.port, False)
            if result != COMM_SUCCESS:
                return None
            if packet[4] == identity and packet[5] + 256 * packet[6] == asked + WRAPPING:
                error = packet[ERROR_PLACE]
                data = bytes(packet[DATA_PLACE : DATA_PLACE + length])
                return Answer(data, bool(error & ALERT)) if not error & ~ALERT else None

    def _raise_silence(self, identity: int) -> None:
        if self.ping(identity):
            raise BadReply(
                f"Servo {identity} answers, but not reliably; check its plugs, the supply, and that no two servos have "
                "one identity."
            )
        raise ServoSilent(f"Servo {identity} does not answer; check its plug and the plugs before it in the chain.")

    @contextmanager
    def _using(self) -> Iterator[None]:
        """Begin an exchange on a quiet line; say it where the port is gone."""
        try:
            self.port.is_using = False
            self.port.drain()
            yield
        except (OSError, termios.error) as error:
            raise lost_port_error(self.port.port_name) from error
