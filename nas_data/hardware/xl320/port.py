"""A serial port as dynamixel-sdk uses it, opened for one program alone and with refusals in sentences."""

import time

import serial
from dynamixel_sdk import PortHandler

from nas_data.hardware.arms.line import PSEUDO_TERMINALS
from nas_data.hardware.arms.port_errors import refusal

BAUD = 1_000_000  # [bit/s] of an XL-320 from the factory
PATIENCE = 0.02  # [s] to wait for a reply beyond its time on the wire: more than any USB latency timer (16 ms)
LENIENCE = 0.04  # [s] the same where another program plays the servos, which must first be given a processor
WAIT = 0.002  # [s] that one look for bytes may last
WRITING = 0.2  # [s] after which a port that takes no bytes is given up


class Port(PortHandler):
    """The SDK's port, which waits for bytes instead of spinning, by a clock that nobody sets."""

    patience = PATIENCE
    is_open: bool = False

    def setupPort(self, cflag_baud: int) -> bool:  # noqa: N802  # the SDK's name
        """Open the port; see `open_port` for the errors."""
        if self.is_open:
            self.closePort()
        self.ser = serial.Serial(self.port_name, cflag_baud, timeout=WAIT, write_timeout=WRITING, exclusive=True)
        self.is_open = True
        self.tx_time_per_byte = 1e4 / cflag_baud  # [ms]
        return True

    def getCurrentTime(self) -> float:  # noqa: N802
        """Return the monotonic time [ms]."""
        return time.monotonic() * 1e3

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start to wait for a packet of some bytes."""
        self.setPacketTimeoutMillis(packet_length * self.tx_time_per_byte + self.patience * 1e3)

    def drain(self) -> None:
        """Forget what has come in and was not asked for."""
        self.ser.reset_input_buffer()


def open_port(path: str, baud: int = BAUD) -> Port:
    """Open a serial port.

    Raises:
        NoSuchPort: there is nothing of that name.
        PortDenied: the user may not open it.
        PortBusy: another program has it.
        ArmError: it is no serial port.
    """
    port = Port(path)
    port.patience = LENIENCE if path.startswith(PSEUDO_TERMINALS) else PATIENCE
    try:
        port.setBaudRate(baud)
    except (OSError, ValueError) as error:
        raise refusal(path, error) from None
    return port
