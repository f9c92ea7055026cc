"""Pseudo-terminal of a simulated arm, open until a stop order or an unplugged adapter."""

import contextlib
import os
import select
import time
import tty

from nas_data.hardware.virtual_bus.device import Device
from nas_data.hardware.virtual_bus.faults.base import LineGone, parse

IDLE = 0.004  # [s] between two updates of the arm without bus traffic
CHUNK = 4096


class Terminal:
    """A port that any serial program can open.

    Attributes:
        path: Path of the port.
    """

    def __init__(self, device: Device) -> None:
        """Open the port.

        Args:
            device: The simulated device.
        """
        self._device = device
        # the terminal's own end is kept open too: a driver that closes the port must not hang up the line
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)

    def serve(self, orders: int) -> None:
        """Answer until the orders end or the adapter is pulled out.

        Args:
            orders: Descriptor of lines such as `fault unplugged:servo=3` and `repair`; its end ends the service.
        """
        with contextlib.suppress(LineGone):
            while self._once(orders):
                self._device.live()
        self.close()
        os.read(orders, CHUNK)  # without a port there is nothing left but to wait for the end

    def close(self) -> None:
        """Pull the adapter out."""
        os.close(self._master)
        os.close(self._slave)

    def _once(self, orders: int) -> bool:
        """Answer pending instructions; return False to stop."""
        ready, _, _ = select.select([self._master, orders], [], [], IDLE)
        if self._master in ready:
            now = time.monotonic()
            replies = self._device.hear(os.read(self._master, CHUNK), now)
            if replies:
                self._say(now + replies[-1][0], b"".join(content for _, content in replies))
        if orders in ready:
            lines = os.read(orders, CHUNK)
            self._obey(lines.decode())
            return bool(lines)
        return True

    def _say(self, when: float, content: bytes) -> None:
        """Send bytes at a monotonic time [s], together as adapters do; what nobody reads is lost, as on a wire."""
        time.sleep(max(0.0, when - time.monotonic()))
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, content)

    def _obey(self, lines: str) -> None:
        for line in lines.split("\n"):
            word, _, rest = line.partition(" ")
            if word == "fault":
                self._device.inject(parse(rest))
            elif word == "repair":
                self._device.repair()
