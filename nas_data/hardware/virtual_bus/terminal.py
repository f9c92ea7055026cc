"""Options of a virtual arm, and the pseudo-terminal that is its port."""

import contextlib
import json
import os
import select
import time
import tty
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.base import parse as parse_effect
from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.arm import MountedServo, VirtualArm
from nas_data.hardware.virtual_bus.device import Device, LockStep, RealClock
from nas_data.hardware.virtual_bus.faults import LineGone
from nas_data.hardware.virtual_bus.faults import parse as parse_fault

IDLE = 0.004  # [s] between two updates of the arm without bus traffic
CHUNK = 4096


class Terminal:
    """A port that any serial program can open."""

    def __init__(self, device: Device) -> None:
        """Open the port."""
        self._device = device
        # the slave end stays open, so that the line survives when a driver closes the port
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)

    def serve(self, orders: int) -> None:
        """Serve until the orders end (lines `fault NAME`, `repair`, `count`), or a fault disconnects the adapter."""
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
                self._device.inject(parse_fault(rest))
            elif word == "repair":
                self._device.repair()
            elif word == "count":
                print(self._device.disturbed, flush=True)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a virtual arm, which can be sent to another process as JSON."""

    effects: tuple[str, ...] = ()  # effects of the arm that its model lacks, in command-line syntax
    faults: tuple[str, ...] = ()  # faults in command-line syntax
    offsets: tuple[int, ...] = ()  # mounting offsets of an ErgoJr's horns [ticks]; zero if empty
    model: str = ""  # name or model file of an arm other than the ErgoJr
    mounted: tuple[MountedServo, ...] = ()  # servos of such an arm
    lying: tuple[float, ...] = ()  # its initial pose [rad], shape (n,)
    seed: int = 0  # seed of random faults
    wire_delay: bool = True  # whether replies are delayed by the transmission time of bytes
    lockstep: bool = False  # whether each goal advances the arm by a period, instead of the clock
    period: float = 0.01  # period in lock-step [s]; by default that of the paper's 100 Hz

    def check(self) -> None:
        """Check the options before a process is started, because errors in that process are not reported well.

        For the check, the faults are applied in order to another arm.

        Raises:
            NasError: an effect or a fault is unknown, malformed, or names a joint or servo that the arm does not have.
        """
        effects = [parse_effect(text) for text in self.effects]
        faults = sorted((parse_fault(text) for text in self.faults), key=lambda fault: fault.after)
        if len(self.offsets) not in (0, 6):
            raise OptionError(f"{len(self.offsets)} offsets are given; one for each of the six servos is needed.")
        if not effects and not faults and not self.mounted:
            return
        arm = self._arm(effects)
        for fault in faults:
            with contextlib.suppress(LineGone):
                fault.apply(arm)

    def to_json(self) -> str:
        """Return the options as one line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "Options":
        """Read the output of `to_json`."""
        values = json.loads(line)
        mounted = tuple(MountedServo(**one) for one in values.pop("mounted"))
        kinds: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in values.items()
        }
        return cls(mounted=mounted, **kinds)

    def open(self) -> Terminal:
        """Create the arm and open its port."""
        arm = self._arm([parse_effect(text) for text in self.effects])
        goal = arm.kind.registers["goal_position"].address
        clock = LockStep(arm.kind.protocol, goal, self.period) if self.lockstep else RealClock()
        faults = [parse_fault(text) for text in self.faults]
        device = Device(arm, clock, faults, np.random.default_rng(self.seed), self.wire_delay)
        return Terminal(device)

    def _arm(self, effects: Sequence[Effect]) -> VirtualArm:
        if self.mounted:
            return VirtualArm.of(effects, self.model, self.mounted, self.lying)
        return VirtualArm.ergojr(effects, self.offsets)
