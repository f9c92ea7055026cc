"""Process of a virtual arm: reads one line of options, prints the path of the port, and serves until its input ends."""

import os

from nas_data.hardware.virtual_bus.terminal import Options


def main() -> None:
    """Serve one arm.

    Input is read without buffering, because the lines after the first one are commands to the terminal.
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
