"""A process that switches an arm's torque off when the one that moves it is gone, or hangs, without a word.

It knows nothing of simulators and datasets, so that it starts at once and needs little.
"""

import contextlib
import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from types import TracebackType

from nas_data.errors import ArmError, GuardLost
from nas_data.hardware.arms.base import Driver
from nas_data.hardware.arms.safety import make_safe, open_charge

ALL_WELL = b"all is well"
HANG = 1.0  # [s] beyond the time that was promised after which a process that says nothing is taken to hang
PATIENCE = 2.0  # [s] in which the port of a process that died must become free
CHUNK = 4096
DIED = "The recorder died"
HUNG = f"The recorder hung for {HANG:g} s and was ended"


class Watchdog:
    """Guards an arm as long as this context is open; leaving it in an orderly way sends the guard home."""

    def __init__(self, driver: Driver) -> None:
        """Start the guard of an arm; until the first promise it looks only for the end of this process."""
        command = [sys.executable, "-m", "nas_data.recorders.watchdog"]
        # a session of its own: Ctrl-C in the terminal is meant for the recorder, and must not take the guard along
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)
        order = {"pid": os.getpid(), "port": driver.port, "charge": driver.charge(), "hang": HANG}
        self._tell(json.dumps(order).encode())

    def promise(self, seconds: float) -> None:
        """Say that all is well, and that the next word comes within a time [s]; a second later the guard acts.

        Raises:
            GuardLost: the guard is gone, and an arm must not be moved without it.
        """
        try:
            self._tell(repr(float(seconds)).encode())
        except BrokenPipeError:
            raise GuardLost(
                "The process that guards the arm is gone, so the arm was stopped; start the same command again."
            ) from None

    def release(self) -> None:
        """Say that the arm is safe."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._tell(ALL_WELL)
        self._process.stdin.close()
        self._process.wait()

    def _tell(self, line: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + b"\n")

    def __enter__(self) -> "Watchdog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def guard() -> None:
    """Listen to the input; where it ends or falls silent, make the arm safe."""
    words = Words(0)
    first = words.wait(math.inf)
    if not first:
        return
    options = json.loads(first[0])
    reason = watch(words, first[1:], options["hang"])
    if reason == HUNG:
        end(options["pid"])
    if reason:
        print(f"nas: {rescue(options['port'], options['charge'], reason)}", file=sys.stderr)


class Words:
    """Lines from a descriptor, with a limit to the wait for them."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._rest = descriptor, b""

    def wait(self, seconds: float) -> list[bytes] | None:
        """Return the lines that come next, none where the input has ended; None where nothing comes in time [s]."""
        until = time.monotonic() + seconds
        while True:
            left = None if math.isinf(seconds) else max(0.0, until - time.monotonic())
            if not select.select([self._descriptor], [], [], left)[0]:
                return None
            heard = os.read(self._descriptor, CHUNK)
            *lines, self._rest = (self._rest + heard).split(b"\n")
            if lines or not heard:
                return lines


def watch(words: Words, lines: list[bytes], hang: float = HANG) -> str:
    """Return why the arm must be made safe, once it must; an empty word where the guard is sent home.

    Args:
        words: What the recorder says: how long [s] until its next word.
        lines: What it has said already.
        hang: How much longer it may be silent [s].
    """
    seconds = math.inf
    while ALL_WELL not in lines:
        seconds = float(lines[-1]) + hang if lines else seconds
        heard = words.wait(seconds)
        if not heard:
            return HUNG if heard is None else DIED
        lines = heard
    return ""


def end(process: int) -> None:
    """Kill the recorder that started this guard: only then is its port free."""
    if os.getppid() == process:  # a number that was given to another process by now must not be hit
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def rescue(port: str, charge: Mapping[str, object], reason: str = DIED) -> str:
    """Hold the arm that a driver charges its guard with, switch its torque off, and say what was done and why."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            arm = open_charge(charge)
            break
        except ArmError as error:
            if time.monotonic() > until:
                return f"{reason} and its arm cannot be reached; switch the supply off. {error}"
            time.sleep(0.05)
    doubt = make_safe(arm)
    arm.close()
    return f"{reason}. {doubt}" if doubt else f"{reason}; the torque of the arm on {port} was switched off."


if __name__ == "__main__":
    guard()
