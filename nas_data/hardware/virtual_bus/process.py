"""A virtual arm in its own process, so that the driver's process does not delay it.

A thread would share Python's global interpreter lock with the recorder, whose busy loop would delay the servos.
"""

import contextlib
import subprocess
import sys
from types import TracebackType

from nas_data.errors import ArmError
from nas_data.hardware.virtual_bus.options import Options


class VirtualBus:
    """A running virtual arm; a context manager that stops it.

    Attributes:
        port: Path of its port.
    """

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
            raise ArmError("The virtual arm did not start; its process said why above.")

    def inject(self, fault: str) -> None:
        """Inject a fault, in command-line syntax."""
        self._say(f"fault {fault}")

    def repair(self) -> None:
        """End the faults that disturb the line."""
        self._say("repair")

    def count_disturbed(self) -> int:
        """Return how many packets the faults changed or delayed; 0 where the line is gone."""
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
