"""A process that switches an arm's torque off when the one that moves it is gone without a word.

It knows nothing of simulators and datasets, so that it starts at once and needs little.
"""

import contextlib
import json
import subprocess
import sys
import time
from dataclasses import asdict
from types import TracebackType

from nas_data.errors import ArmError
from nas_data.xl320.joints import Joints

ALL_WELL = "all is well\n"
PATIENCE = 2.0  # [s] in which the port of a process that died must become free


class Watchdog:
    """Guards an arm as long as this context is open; leaving it in an orderly way sends the guard home."""

    def __init__(self, port: str, joints: Joints) -> None:
        """Start the guard.

        Args:
            port: Where the arm is.
            joints: Its joints.
        """
        command = [sys.executable, "-m", "nas_data.recorders.watchdog"]
        # a session of its own: Ctrl-C in the terminal is meant for the recorder, and must not take the guard along
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, start_new_session=True)
        self._tell(json.dumps({"port": port, "joints": asdict(joints)}) + "\n")

    def release(self) -> None:
        """Say that the arm is safe."""
        with contextlib.suppress(BrokenPipeError):
            self._tell(ALL_WELL)
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line)
        self._process.stdin.flush()

    def __enter__(self) -> "Watchdog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def guard() -> None:
    """Wait for the end of the input; where it comes without a word, make the arm safe."""
    first = sys.stdin.readline()
    if not first or sys.stdin.readline() == ALL_WELL:
        return
    options = json.loads(first)
    joints = Joints(**{key: tuple(value) for key, value in options["joints"].items()})
    print(f"nas: {rescue(options['port'], joints)}", file=sys.stderr)


def rescue(port: str, joints: Joints) -> str:
    """Hold the arm, switch its torque off, and say what was done."""
    from nas_data.xl320.arm import Arm

    until = time.monotonic() + PATIENCE
    while True:
        try:
            arm = Arm(port, joints)
            break
        except ArmError as error:
            if time.monotonic() > until:
                return f"The recorder died and its arm cannot be reached; switch the supply off. {error}"
            time.sleep(0.05)
    reason = arm.make_safe()
    arm.close()
    return reason or f"The recorder died; the torque of the arm on {port} was switched off."


if __name__ == "__main__":
    guard()
