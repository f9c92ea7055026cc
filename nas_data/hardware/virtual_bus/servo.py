"""One simulated servo: its control table, and reads and writes of it."""

from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.kinds.base import Reason, ServoDrive, ServoSeries
from nas_data.hardware.virtual_bus.kinds.xl320 import KIND as XL320
from nas_data.hardware.virtual_bus.packet import Error
from nas_data.hardware.xl320.control_table import ControlTableEntry

EVERYTHING, BUT_ID, BUT_ID_AND_BAUD = 0xFF, 0x01, 0x02  # what a factory reset resets


class VirtualServo:
    """A control table with the rules of its series."""

    def __init__(self, identity: int, model_number: int | None = None, kind: ServoSeries = XL320) -> None:
        """Create a servo with factory settings and an ID."""
        self.kind, self.memory = kind, bytearray(kind.size)
        self._drive: ServoDrive | None = None
        self.answers_sync = True  # whether the firmware supports sync read
        self._registered: tuple[int, bytes] | None = None
        for name, register in kind.registers.items():
            self.put(name, register.initial)
        self.put("id", identity)
        if model_number is not None:
            self.put("model_number", model_number)

    def get(self, name: str) -> int:
        """Return the value of a register."""
        register = self.kind.registers[name]
        return int.from_bytes(self.memory[register.address : register.address + register.size], "little")

    def put(self, name: str, value: int) -> None:
        """Set a register without checks of access and range.

        Raises:
            OptionError: the value is negative or needs more bytes than the register has.
        """
        register = self.kind.registers[name]
        if not 0 <= value < 256**register.size:
            raise OptionError(f"{name} is {value}; it must lie in 0 … {256**register.size - 1}.")
        place = slice(register.address, register.address + register.size)
        content = value.to_bytes(register.size, "little")
        if self.memory[place] != content:
            self.memory[place] = content
            self._drive = self._drive if name.startswith(("present", "moving")) else None

    @property
    def drive(self) -> ServoDrive:
        """Drive state that the registers define."""
        if self._drive is None:
            self._drive = self.kind.drive(self)
        return self._drive

    def read(self, address: int, length: int) -> tuple[Error, bytes]:
        """Return a range of the memory."""
        if not 0 < length <= len(self.memory) - address:
            return Error.ACCESS, b""
        return Error.NONE, bytes(self.memory[address : address + length])

    def write(self, address: int, data: bytes) -> Error:
        """Write a range of the memory; nothing is written if any part of it is refused."""
        error = self.check_write(address, data)
        if error is Error.NONE:
            self.memory[address : address + len(data)] = data
            self._drive = None
            if self.kind.by_address[address] is self.kind.registers["torque_enable"] and not data[0]:
                self.put("moving", 0)
        return error

    def check_write(self, address: int, data: bytes) -> Error:
        """Return the error of a write to a range of the memory."""
        end = address + len(data)
        by_address = self.kind.by_address
        if not data or end > len(self.memory) or address not in by_address:
            return Error.ACCESS
        registers = {by_address[byte].address: by_address[byte] for byte in range(address, end) if byte in by_address}
        for register in registers.values():
            start = register.address - address
            if start < 0 or register.address + register.size > end:
                return Error.DATA_LENGTH
            error = self._check_register(register, int.from_bytes(data[start : start + register.size], "little"))
            if error is not Error.NONE:
                return error
        return Error.NONE

    def _check_register(self, register: ControlTableEntry, value: int) -> Error:
        if not register.writable or self.kind.is_locked(self, register):
            return Error.ACCESS
        if not register.low <= value <= register.high:
            return Error.DATA_RANGE
        return self.kind.check_write(self, register, value)

    def register_write(self, address: int, data: bytes) -> Error:
        """Store a write until the next `act`."""
        error = self.check_write(address, data)
        if error is Error.NONE:
            self._registered = (address, data)
            self.put("registered", 1)
        return error

    def act(self) -> Error:
        """Execute the stored write."""
        if self._registered is None:
            return Error.RESULT_FAIL
        address, data = self._registered
        self._registered = None
        self.put("registered", 0)
        return self.write(address, data)

    def reboot(self) -> Error:
        """Restart: volatile registers get their initial values, which clears errors."""
        for name, register in self.kind.registers.items():
            if not self.kind.is_persistent(register) and not name.startswith("present"):
                self.put(name, register.initial)
        self.kind.power_on(self)
        self._registered = None
        return Error.NONE

    def factory_reset(self, what: int) -> Error:
        """Reset all registers, all but the ID, or all but ID and baud rate, to factory settings."""
        if what not in (EVERYTHING, BUT_ID, BUT_ID_AND_BAUD):
            return Error.DATA_RANGE
        if self.get("torque_enable"):
            return Error.ACCESS
        kept = {EVERYTHING: (), BUT_ID: ("id",), BUT_ID_AND_BAUD: ("id", "baud_rate")}[what]
        values = {name: self.get(name) for name in (*kept, "model_number", "firmware")}
        for name, register in self.kind.registers.items():
            if self.kind.is_persistent(register):
                self.put(name, register.initial)
        for name, value in values.items():
            self.put(name, value)
        return self.reboot()

    def fail(self, reason: int) -> None:
        """Set a hardware error; see `ServoSeries.fail`."""
        self.kind.fail(self, Reason(reason))
