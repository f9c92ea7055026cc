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
        # the slave end stays open, so that the line survives when a driver closes the port
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)

    def serve(self, orders: int) -> None:
        """Serve until the stream of orders ends or a fault disconnects the adapter.

        Args:
            orders: File descriptor of lines such as `fault unplugged:servo=3`, `repair`, and `count`.
        """
        with contextlib.suppress(LineGone):
            while self._serve_once(orders):
                self._device.advance()
        self.close()
        os.read(orders, CHUNK)  # without a port, wait for the end of the orders

    def close(self) -> None:
        """Close the port."""
        os.close(self._master)
        os.close(self._slave)

    def _serve_once(self, orders: int) -> bool:
        """Answer pending instructions; return False to stop."""
        ready, _, _ = select.select([self._master, orders], [], [], IDLE)
        if self._master in ready:
            now = time.monotonic()
            replies = self._device.receive(os.read(self._master, CHUNK), now)
            if replies:
                self._say(now + replies[-1][0], b"".join(content for _, content in replies))
        if orders in ready:
            lines = os.read(orders, CHUNK)
            self._execute(lines.decode())
            return bool(lines)
        return True

    def _say(self, when: float, content: bytes) -> None:
        """Send bytes together at a monotonic time [s]; bytes that nobody reads are lost, as on a real line."""
        time.sleep(max(0.0, when - time.monotonic()))
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, content)

    def _execute(self, lines: str) -> None:
        for line in lines.split("\n"):
            word, _, rest = line.partition(" ")
            if word == "fault":
                self._device.inject(parse(rest))
            elif word == "repair":
                self._device.repair()
            elif word == "count":
                print(self._device.disturbed, flush=True)
