"""One simulated XL-320: its memory, and what it does when it is asked to read or write."""

from nas_data.errors import OptionError
from nas_data.virtual_bus.packet import ALERT, Error
from nas_data.xl320.control_table import OVERHEAT, OVERLOAD, REGISTERS, SIZE, VOLTAGE, Register

AT_BYTE = {r.address + k: r for r in REGISTERS.values() for k in range(r.size)}
FREE = frozenset(range(SIZE)) - set(AT_BYTE)  # addresses without a register read as zero
REASONS = {OVERLOAD: "overload", OVERHEAT: "overheat", VOLTAGE: "voltage"}
EVERYTHING, BUT_ID, BUT_ID_AND_BAUD = 0xFF, 0x01, 0x02  # what a factory reset forgets


class Servo:
    """A control table with the rules of the e-manual.

    Attributes:
        memory: The table.
        answers_sync: Whether the firmware knows sync read.
    """

    def __init__(self, identity: int, model_number: int | None = None) -> None:
        """Take a servo out of its box, and give it an identity."""
        self.memory = bytearray(SIZE)
        self.answers_sync = True
        self._registered: tuple[int, bytes] | None = None
        for name, register in REGISTERS.items():
            self.put(name, register.initial)
        self.put("id", identity)
        if model_number is not None:
            self.put("model_number", model_number)

    def get(self, name: str) -> int:
        """Return a register."""
        register = REGISTERS[name]
        return int.from_bytes(self.memory[register.address : register.address + register.size], "little")

    def put(self, name: str, value: int) -> None:
        """Set a register, whatever its rules are.

        Raises:
            OptionError: the value is negative or needs more bytes than the register has.
        """
        register = REGISTERS[name]
        if not 0 <= value < 256**register.size:
            raise OptionError(f"{name} is {value}; it must lie in 0 … {256**register.size - 1}.")
        self.memory[register.address : register.address + register.size] = value.to_bytes(register.size, "little")

    @property
    def alert(self) -> int:
        """The bit that every answer carries while there is a hardware error."""
        return ALERT if self.get("hardware_error") else 0

    def read(self, address: int, length: int) -> tuple[Error, bytes]:
        """Return a stretch of the memory."""
        if not 0 < length <= SIZE - address:
            return Error.ACCESS, b""
        return Error.NONE, bytes(self.memory[address : address + length])

    def write(self, address: int, data: bytes) -> Error:
        """Write a stretch of the memory where all of it may be written; nothing otherwise."""
        error = self.judge(address, data)
        if error is Error.NONE:
            self.memory[address : address + len(data)] = data
            if AT_BYTE[address] is REGISTERS["torque_enable"] and not data[0]:
                self.put("moving", 0)
        return error

    def judge(self, address: int, data: bytes) -> Error:
        """Say why a stretch may not be written."""
        end = address + len(data)
        if not data or end > SIZE or address in FREE:
            return Error.ACCESS
        registers = {AT_BYTE[place].address: AT_BYTE[place] for place in range(address, end) if place in AT_BYTE}
        for register in registers.values():
            start = register.address - address
            if start < 0 or register.address + register.size > end:
                return Error.DATA_LENGTH
            error = self._judge(register, int.from_bytes(data[start : start + register.size], "little"))
            if error is not Error.NONE:
                return error
        return Error.NONE

    def _judge(self, register: Register, value: int) -> Error:
        locked = register.eeprom and self.get("torque_enable")
        if not register.writable or locked:
            return Error.ACCESS
        if not register.low <= value <= register.high:
            return Error.DATA_RANGE
        low, high = self.get("cw_limit"), self.get("ccw_limit")
        if register.name == "goal_position" and not low <= value <= high and self.get("control_mode") == 2:
            return Error.DATA_LIMIT
        return Error.NONE

    def register_write(self, address: int, data: bytes) -> Error:
        """Keep a write for the next action."""
        error = self.judge(address, data)
        if error is Error.NONE:
            self._registered = (address, data)
            self.put("registered", 1)
        return error

    def act(self) -> Error:
        """Do what was registered."""
        if self._registered is None:
            return Error.RESULT_FAIL
        address, data = self._registered
        self._registered = None
        self.put("registered", 0)
        return self.write(address, data)

    def reboot(self) -> Error:
        """Start anew: memory that a loss of power forgets gets its initial values, errors are gone."""
        for name, register in REGISTERS.items():
            if not register.eeprom and not name.startswith("present"):
                self.put(name, register.initial)
        self.put("torque_limit", self.get("max_torque"))
        self._registered = None
        return Error.NONE

    def factory_reset(self, what: int) -> Error:
        """Forget everything, or all but the identity, or all but identity and baud rate."""
        if what not in (EVERYTHING, BUT_ID, BUT_ID_AND_BAUD):
            return Error.DATA_RANGE
        if self.get("torque_enable"):
            return Error.ACCESS
        kept = {EVERYTHING: (), BUT_ID: ("id",), BUT_ID_AND_BAUD: ("id", "baud_rate")}[what]
        values = {name: self.get(name) for name in (*kept, "model_number", "firmware")}
        for name, register in REGISTERS.items():
            if register.eeprom:
                self.put(name, register.initial)
        for name, value in values.items():
            self.put(name, value)
        return self.reboot()

    def fail(self, reason: int) -> None:
        """Note a hardware error; where it is one that shuts the servo down, its torque limit falls to zero."""
        self.put("hardware_error", self.get("hardware_error") | reason)
        if self.get("shutdown") & reason:
            self.put("torque_limit", 0)
