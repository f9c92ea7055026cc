"""Watchdog process: it switches an arm's torque off when the process that moves the arm dies or hangs.

It imports neither simulators nor datasets, so that it starts quickly and needs little memory.
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
from dataclasses import asdict
from types import TracebackType

from nas_data.errors import ArmError, GuardLost
from nas_data.hardware.arms.base import ArmOpener, Driver, make_safe

HEARTBEAT = b"all is well"
HANG = 1.0  # [s] after its deadline at which a silent process counts as hung
PATIENCE = 2.0  # [s] to wait for the port of a dead process to become free
CHUNK = 4096
DIED = "The recorder died"
HUNG = f"The recorder did not respond for {HANG:g} s and was ended"


class Watchdog:
    """Runs the watchdog process of an arm; leaving this context in an orderly way ends it."""

    def __init__(self, driver: Driver) -> None:
        """Start the process. Until the first `extend_deadline` it only watches for the end of this process."""
        command = [sys.executable, "-m", "nas_data.recorders.watchdog"]
        # a new session: Ctrl-C in the terminal is for the recorder and must not end the watchdog
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)
        order = {"pid": os.getpid(), "port": driver.port, "opener": asdict(driver.opener()), "hang": HANG}
        self._tell(json.dumps(order).encode())

    def extend_deadline(self, seconds: float) -> None:
        """Announce the next message within a time [s]. One second after that the watchdog stops the arm.

        Raises:
            GuardLost: the watchdog has ended; the arm must not move without it.
        """
        try:
            self._tell(repr(float(seconds)).encode())
        except BrokenPipeError:
            raise GuardLost(
                "The watchdog process of the arm ended, so the arm was stopped; run the same command again."
            ) from None

    def release(self) -> None:
        """Report that the arm is safe, and wait for the watchdog to end."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._tell(HEARTBEAT)
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
    """Read messages from standard input; make the arm safe when they end or stop coming."""
    words = LineReader(0)
    first = words.wait(math.inf)
    if not first:
        return
    options = json.loads(first[0])
    reason = watch(words, first[1:], options["hang"])
    if reason == HUNG:
        kill_recorder(options["pid"])
    if reason:
        print(f"nas: {rescue(options['port'], ArmOpener(**options['opener']), reason)}", file=sys.stderr)


class LineReader:
    """Reads lines from a file descriptor, with a timeout."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._rest = descriptor, b""

    def wait(self, seconds: float) -> list[bytes] | None:
        """Return the next lines, [] at the end of the input, or None after a timeout [s]."""
        until = time.monotonic() + seconds
        while True:
            left = None if math.isinf(seconds) else max(0.0, until - time.monotonic())
            if not select.select([self._descriptor], [], [], left)[0]:
                return None
            received = os.read(self._descriptor, CHUNK)
            *lines, self._rest = (self._rest + received).split(b"\n")
            if lines or not received:
                return lines


def watch(words: LineReader, lines: list[bytes], hang: float = HANG) -> str:
    """Watch the recorder, and return why the arm must be made safe; empty after an orderly end.

    Args:
        words: Messages of the recorder, each the time until its next one [s].
        lines: Messages that were already read.
        hang: Grace period after the deadline [s].
    """
    seconds = math.inf
    while HEARTBEAT not in lines:
        seconds = float(lines[-1]) + hang if lines else seconds
        received = words.wait(seconds)
        if not received:
            return HUNG if received is None else DIED
        lines = received
    return ""


def kill_recorder(process: int) -> None:
    """Kill the recorder that started this watchdog: only then is its port free."""
    if os.getppid() == process:  # the id may belong to another process by now
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def rescue(port: str, opener: ArmOpener, reason: str = DIED) -> str:
    """Open the arm, hold it, and switch its torque off; return a sentence on what was done and why.

    Args:
        port: Path of the port, for the sentence.
        opener: How to open the arm; see `Driver.opener`.
        reason: Why the arm is stopped.
    """
    until = time.monotonic() + PATIENCE
    while True:
        try:
            arm = opener.open()
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
