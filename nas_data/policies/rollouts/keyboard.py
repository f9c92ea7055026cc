"""Hits from a keyboard: sword and shield have conductive paint and press a key of a MakeyMakey.

Source: Linux, `include/uapi/linux/input.h` and `input-event-codes.h`: 24-byte events of time, type, code and value.
"""

import os
import struct
from pathlib import Path
from types import TracebackType

import numpy as np

from nas_data.errors import OptionError
from nas_data.simulators.base import Stepper

EVENT = struct.Struct("llHHi")  # seconds, microseconds, type, code, value
KEY_EVENT, KEY_S = 1, 31  # the authors' MakeyMakey sends an "s"
RELEASED = 0  # value of an event; 1 is pressed, 2 repeated
EVENTS = 64  # read at once


class Keyboard:
    """A key that is pressed while sword and shield touch; a context manager that closes the device."""

    def __init__(self, path: str) -> None:
        """Open an input device.

        Raises:
            OptionError: there is no such device, or the user may not read it.
        """
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except PermissionError:
            raise OptionError(
                f"{path} may not be read by this user; join its group (sudo usermod -aG input $USER) and log in again."
            ) from None
        except OSError as error:
            raise OptionError(
                f"{path} cannot be read as a keyboard ({(error.strerror or str(error)).lower()}); give --hits one of: "
                f"{list_keyboards()}."
            ) from None
        self._path, self._held = path, False

    def __call__(self, stepper: Stepper) -> np.ndarray:
        """Return whether the key was pressed since the last call or still is, shape (1,).

        Raises:
            OptionError: the device is gone.
        """
        pressed = self._held
        for kind, code, value in self._read_events():
            if (kind, code) == (KEY_EVENT, KEY_S):
                self._held = value != RELEASED
                pressed |= self._held
        return np.array([pressed])

    def _read_events(self) -> list[tuple[int, int, int]]:
        """Return type, code and value of the new events."""
        try:
            content = os.read(self._descriptor, EVENTS * EVENT.size)
        except BlockingIOError:
            return []
        except OSError:
            raise OptionError(f"{self._path} vanished while it was read; plug the MakeyMakey in again.") from None
        whole = content[: len(content) // EVENT.size * EVENT.size]
        return [event[2:] for event in EVENT.iter_unpack(whole)]

    def __enter__(self) -> "Keyboard":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)


def list_keyboards() -> str:
    """Return the available keyboards as a list for a sentence."""
    found = sorted(str(path) for path in Path("/dev/input/by-id").glob("*-kbd"))
    return ", ".join([*found, "simulated"])
