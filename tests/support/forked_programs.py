"""Virtual arms and guards of arms in processes forked from one that has imported all they need: each starts at once."""

import multiprocessing
import os
import subprocess
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from types import SimpleNamespace
from unittest.mock import patch

from nas_data.hardware.virtual_bus import __main__ as virtual_bus
from nas_data.recorders import watchdog

MAINS = {"nas_data.hardware.virtual_bus": virtual_bus.main, "nas_data.recorders.watchdog": watchdog.guard}
FORKING = multiprocessing.get_context("forkserver")
SERVER = forkserver.ForkServer()  # its own: that of other tests imports LeRobot, and forks more slowly for it
SERVER.set_forkserver_preload(["nas_data.hardware.virtual_bus.__main__", "nas_data.recorders.watchdog"])


class Forked:
    """What `subprocess.Popen` is to these programs: streams, and an end to wait for."""

    def __init__(
        self,
        command: list[str],
        stdin: int,
        start_new_session: bool,
        stdout: int | None = None,
        text: bool = False,
        bufsize: int = -1,
    ) -> None:
        assert stdin == subprocess.PIPE and start_new_session
        heard, orders = FORKING.Pipe(duplex=False)
        answers, told = FORKING.Pipe(duplex=False) if stdout == subprocess.PIPE else (None, None)
        self._process = FORKING.Process(target=serve, args=(command[2], heard, told), daemon=True)
        with patch.object(forkserver, "connect_to_new_process", SERVER.connect_to_new_process):
            self._process.start()
        self.pid = self._process.pid
        self.stdin = open_stream(orders, "w" if text else "wb", bufsize)
        self.stdout = open_stream(answers, "r" if text else "rb", bufsize) if answers else None
        for connection in (heard, told):
            if connection:
                connection.close()

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode

    def kill(self) -> None:
        self._process.kill()


def open_stream(connection: Connection, mode: str, bufsize: int):
    """Return a file in the place of a connection."""
    with connection:
        return os.fdopen(os.dup(connection.fileno()), mode, bufsize)


def serve(module: str, heard: Connection, told: Connection | None) -> None:
    """Run a program in this process, its streams joined to connections."""
    os.setsid()
    for stream, connection in ((0, heard), (1, told)):
        if connection:
            os.dup2(connection.fileno(), stream)
            connection.close()
    MAINS[module]()


INSTEAD = SimpleNamespace(Popen=Forked, PIPE=subprocess.PIPE)
