"""The process of a virtual arm: one line of options in, the port's path out, then it answers until its input ends."""

import os

from nas_data.hardware.virtual_bus.options import Options


def main() -> None:
    """Serve one arm.

    Input is read unbuffered: what comes after the first line are orders to the terminal.
    """
    line = b""
    while not line.endswith(b"\n"):
        byte = os.read(0, 1)
        if not byte:
            return
        line += byte
    terminal = Options.from_json(line.decode()).open()
    print(terminal.path, flush=True)
    terminal.serve(orders=0)


if __name__ == "__main__":
    main()
