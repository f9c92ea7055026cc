"""A virtual arm behind the port name `virtual`, in its own process, so that the driver's process does not delay it.

A thread would share Python's global interpreter lock with the recorder, whose busy loop would delay the servos.
"""

import contextlib
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import TracebackType

from nas_data.errors import ArmError, OptionError
from nas_data.hardware.virtual_bus.terminal import Options

VIRTUAL = "virtual"


class VirtualBus:
    """A running virtual arm; a context manager that stops it."""

    def __init__(self, options: Options) -> None:
        """Start the arm.

        Raises:
            NasError: the options are malformed.
            ArmError: the process did not start.
        """
        options.check()
        command = [sys.executable, "-m", "nas_data.hardware.virtual_bus"]
        # its own session: Ctrl-C in the terminal must not stop the arm before the driver has stopped it safely
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self._process.stdout is not None
        self._say(options.to_json())
        self.port = self._process.stdout.readline().strip()
        if not self.port:
            self.stop()
            raise ArmError("The virtual arm did not start; its process printed the reason above.")

    def inject(self, fault: str) -> None:
        """Inject a fault, in command-line syntax."""
        self._say(f"fault {fault}")

    def repair(self) -> None:
        """End the faults that disturb the line."""
        self._say("repair")

    def count_disturbed(self) -> int:
        """Return the number of packets that faults changed or delayed; 0 if the line is gone."""
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._say("count")
        return int(self._process.stdout.readline() or 0)

    def stop(self) -> None:
        """Stop the process."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None and not stream.closed:
                stream.close()
        self._process.wait()

    def _say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def __enter__(self) -> "VirtualBus":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


@contextmanager
def port_of(
    name: str,
    effects: Sequence[str] = (),
    faults: Sequence[str] = (),
    lockstep: bool = False,
    arm: Options | None = None,
) -> Iterator[str]:
    """Yield the path of a port: the name itself, or the port of a new virtual arm.

    Args:
        name: A path, or `virtual`.
        effects: Effects of the virtual arm that its model lacks.
        faults: Faults of the virtual arm.
        lockstep: Whether each goal advances the virtual arm by a period, without delays, instead of the clock.
        arm: Options of the virtual arm; those of an ErgoJr if None.

    Raises:
        OptionError: effects, faults or lock-step are given for a real arm.
    """
    if name != VIRTUAL:
        if effects or faults or lockstep:
            raise OptionError(f"Effects, faults and lock-step belong to --port {VIRTUAL}; {name} is a real arm.")
        yield name
        return
    options = replace(
        arm or Options(), effects=tuple(effects), faults=tuple(faults), wire_delay=not lockstep, lockstep=lockstep
    )
    with VirtualBus(options) as bus:
        yield bus.port
