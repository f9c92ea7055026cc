"""Servos on one bus: which of them answer an instruction, in which order and after which delay."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from nas_data.hardware.virtual_bus.packet import BROADCAST, Error, Instruction, Packet
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.hardware.xl320.control_table import DELAY_UNIT


@dataclass(frozen=True)
class Reply:
    """An answer on the wire."""

    content: bytes  # its bytes
    pause: float  # delay after the previous packet [s]
    together: bool = False  # whether it starts together with the previous reply, because two servos have one ID


class ServoChain:
    """The servos of an arm with one protocol; several may have the same ID by mistake."""

    def __init__(self, servos: Sequence[VirtualServo]) -> None:
        self.servos = list(servos)
        self._protocol = self.servos[0].kind.protocol
        self._single: dict[int, Callable[[VirtualServo, bytes], tuple[Error, bytes]]] = {
            Instruction.PING: self._ping,
            Instruction.READ: self._read,
            Instruction.WRITE: self._write,
            Instruction.REG_WRITE: self._reg_write,
            Instruction.ACTION: lambda servo, _: (servo.act(), b""),
            Instruction.REBOOT: lambda servo, _: (servo.reboot(), b""),
            Instruction.FACTORY_RESET: lambda servo, what: (servo.factory_reset(what[0] if what else -1), b""),
        }
        self._several: dict[int, Callable[[bytes], list[Reply]]] = {
            Instruction.SYNC_READ: self._sync_read,
            Instruction.SYNC_WRITE: self._sync_write,
            Instruction.BULK_READ: self._bulk_read,
            Instruction.BULK_WRITE: self._bulk_write,
        }

    def respond(self, packet: Packet) -> list[Reply]:
        """Execute an instruction; return the replies."""
        if packet.instruction == Instruction.STATUS:
            return []
        if packet.instruction in self._several:
            return self._several[packet.instruction](packet.parameters) if packet.is_valid else []
        if packet.id == BROADCAST:
            return self._broadcast(packet)
        replies = [self._execute(servo, packet) for servo in self.find_servos(packet.id)]
        sent = enumerate(_drop_none(replies))
        return [Reply(reply.content, reply.pause, together=index > 0) for index, reply in sent]

    def find_servos(self, identity: int) -> list[VirtualServo]:
        """Return the servos with an ID; a correct arm has one."""
        return [servo for servo in self.servos if servo.get("id") == identity]

    def _broadcast(self, packet: Packet) -> list[Reply]:
        """Execute a broadcast; only a ping is answered, by each servo in the order of the IDs."""
        if not packet.is_valid:
            return []
        servos = sorted(self.servos, key=lambda servo: servo.get("id"))
        replies = _drop_none([self._execute(servo, packet) for servo in servos])
        return replies if packet.instruction == Instruction.PING else []

    def _execute(self, servo: VirtualServo, packet: Packet) -> Reply | None:
        """Execute an instruction on one servo; None if its status level suppresses the reply."""
        handler = self._single.get(packet.instruction)
        if not packet.is_valid:
            error, data = Error.CRC, b""
        elif handler is None:
            error, data = Error.INSTRUCTION, b""
        else:
            error, data = handler(servo, packet.parameters)
        silent = not self._protocol.answers_errors and (handler is None or not packet.is_valid)
        answers = servo.kind.answers(servo, packet.instruction) and not silent
        return self._reply(servo, error, data) if answers else None

    def _sync_read(self, parameters: bytes) -> list[Reply]:
        """Answer in order; after a missing servo no later one answers."""
        address, length, ids = *self._parse_address_range(parameters), parameters[2 * self._protocol.width :]
        return self._read_each([(identity, address, length) for identity in ids])

    def _bulk_read(self, parameters: bytes) -> list[Reply]:
        entries = [parameters[start : start + 5] for start in range(0, len(parameters) - 4, 5)]
        return self._read_each([(entry[0], _parse_word(entry, 1), _parse_word(entry, 3)) for entry in entries])

    def _read_each(self, wanted: Sequence[tuple[int, int, int]]) -> list[Reply]:
        replies: list[Reply] = []
        for identity, address, length in wanted:
            servos = [servo for servo in self.find_servos(identity) if servo.answers_sync]
            if not servos:
                break
            for index, servo in enumerate(servos):
                reply = self._reply(servo, *servo.read(address, length))
                replies.append(Reply(reply.content, reply.pause, together=index > 0))
        return replies

    def _sync_write(self, parameters: bytes) -> list[Reply]:
        address, length = self._parse_address_range(parameters)
        for start in range(2 * self._protocol.width, len(parameters) - length, length + 1):
            for servo in self.find_servos(parameters[start]):
                servo.write(address, parameters[start + 1 : start + 1 + length])
        return []

    def _bulk_write(self, parameters: bytes) -> list[Reply]:
        start = 0
        while start + 5 <= len(parameters):
            address, length = _parse_word(parameters, start + 1), _parse_word(parameters, start + 3)
            for servo in self.find_servos(parameters[start]):
                servo.write(address, parameters[start + 5 : start + 5 + length])
            start += 5 + length
        return []

    def _reply(self, servo: VirtualServo, error: Error, data: bytes) -> Reply:
        byte = servo.kind.error_byte(servo, error)
        return Reply(self._protocol.status(servo.get("id"), byte, data), servo.get("return_delay") * DELAY_UNIT)

    def _parse_address_range(self, parameters: bytes) -> tuple[int, int]:
        """Return address and length, with which parameters begin."""
        return self._protocol.number(parameters, 0), self._protocol.number(parameters, 1)

    def _ping(self, servo: VirtualServo, _: bytes) -> tuple[Error, bytes]:
        return servo.read(0, 3) if self._protocol.ping_has_model else (Error.NONE, b"")  # model number and firmware

    def _read(self, servo: VirtualServo, parameters: bytes) -> tuple[Error, bytes]:
        if len(parameters) != 2 * self._protocol.width:
            return Error.DATA_LENGTH, b""
        return servo.read(*self._parse_address_range(parameters))

    def _write(self, servo: VirtualServo, parameters: bytes) -> tuple[Error, bytes]:
        return servo.write(self._protocol.number(parameters, 0), parameters[self._protocol.width :]), b""

    def _reg_write(self, servo: VirtualServo, parameters: bytes) -> tuple[Error, bytes]:
        return servo.register_write(self._protocol.number(parameters, 0), parameters[self._protocol.width :]), b""


def _drop_none(replies: Sequence[Reply | None]) -> list[Reply]:
    return [reply for reply in replies if reply is not None]


def _parse_word(parameters: bytes, start: int) -> int:
    return int.from_bytes(parameters[start : start + 2], "little")
