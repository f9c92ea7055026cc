"""An exclusive serial port for dynamixel-sdk."""

import time

import serial
from dynamixel_sdk import PortHandler

from nas_data.hardware.arms.line import LENIENCE, PSEUDO_TERMINALS
from nas_data.hardware.arms.port_errors import make_port_error

BAUD = 1_000_000  # [bit/s] factory setting of an XL-320
PATIENCE = 0.02  # [s] timeout of a reply in addition to its transmission time; USB latency timers take up to 16 ms
WAIT = 0.002  # [s] read timeout
WRITING = 0.2  # [s] write timeout


class Port(PortHandler):
    """The SDK's port with blocking reads instead of busy waiting, and a monotonic clock."""

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
