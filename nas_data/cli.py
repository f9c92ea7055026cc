"""The program `nas`: finds the command's file, parses its options with tyro and runs it."""

import contextlib
import importlib
import io
import itertools
import json
import os
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data import __version__
from nas_data.errors import NasError, OptionError
from nas_data.log import logger, show
from nas_data.visible_files import list_visible_files

if TYPE_CHECKING:
    from nas_data.commands.base import Command

COMMANDS = Path(__file__).parent / "commands"
ARGUMENT = 4  # indentation [columns] of a missing option in tyro's message; its help text is indented more


def list_command_files() -> dict[str, Path]:
    """Return command → file, for example for 'policy train'."""
    files = [path for path in list_visible_files(COMMANDS, "*.py") if path.stem != "base" and path.stem[0] != "_"]
    return {path.stem.rstrip("_").replace("_", " "): path for path in files}


def read_summary(path: Path) -> str:
    """Return the summary line of a command file's docstring."""
    with path.open(encoding="utf-8") as file:
        return file.readline().strip().strip('"')


def format_overview(prefix: str = "") -> str:
    """Return the list of commands that start with a prefix."""
    chosen = {name: path for name, path in list_command_files().items() if name.startswith(prefix)}
    width = max((len(name) for name in chosen), default=0)
    lines = [f"usage: nas {prefix + ' ' if prefix else ''}COMMAND [OPTIONS]", ""]
    if not prefix:
        lines += [f"nas_data {__version__}: record, pair, learn and name the gap between a simulator and a robot.", ""]
    lines += [f"  {name:<{width}}  {read_summary(path)}" for name, path in chosen.items()]
    lines += ["", "Help with an example: nas COMMAND --help"]
    return "\n".join(lines)


def split(arguments: Sequence[str]) -> tuple[str | None, list[str]]:
    """Split arguments into the longest known command and the rest."""
    files = list_command_files()
    for count in range(min(3, len(arguments)), 0, -1):
        name = " ".join(arguments[:count])
        if name in files:
            return name, list(arguments[count:])
    return None, list(arguments)


def load_command_class(name: str) -> "type[Command]":
    """Import the command class of a command's file."""
    from nas_data.commands.base import Command

    module = importlib.import_module(f"nas_data.commands.{list_command_files()[name].stem}")
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, Command) and value.__module__ == module.__name__:
            return value
    raise TypeError(f"{module.__name__} defines no Command")


def fail(message: str, as_json: bool) -> int:
    """Print an error to stderr (and as JSON if requested) and return exit code 2."""
    if as_json:
        print(json.dumps({"error": message}))
    logger.error(f"nas: {message}")
    return 2


def describe_refusal(error: OSError) -> str:
    """Describe an error of the operating system, with the file it concerns."""
    reason = " ".join((error.strerror or str(error)).split())
    if error.filename is None:
        return f"A file could not be read or written: {reason}."
    return f"{error.filename} could not be read or written: {reason[:1].lower()}{reason[1:]}; choose another path."


def is_of_package(error: BaseException, package: str) -> bool:
    """Whether an error was raised while a file of a package ran."""
    return any(package in Path(frame.filename).parts for frame in traceback.extract_tb(error.__traceback__))


def answer_unknown(arguments: Sequence[str]) -> int:
    """Answer an unknown command: list the commands with the same prefix, or print an error."""
    word = arguments[0]
    if any(name.startswith(word + " ") for name in list_command_files()) and set(arguments[1:]) <= {"-h", "--help"}:
        print(format_overview(word))
        return 0 if len(arguments) > 1 else 2
    words = [word for word in arguments if not word.startswith("-")][:2] or arguments[:1]
    return fail(f"There is no command '{' '.join(words)}'; see: nas --help", "--json" in arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program and return its exit code: 0 success, 1 a negative answer, 2 bad input, 130 interrupted."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal whose locale lacks φ shows "?" instead of failing
    show()
    try:
        return answer(list(sys.argv[1:] if arguments is None else arguments))
    except BrokenPipeError:
        handle_broken_pipe()
        return 0


def handle_broken_pipe() -> None:
    """Discard pending output after its reader (head, less) closed the pipe; Python would report that at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def answer(arguments: list[str]) -> int:
    """Run the command in the arguments and return the exit code, as `main` does."""
    if not arguments or arguments[0] in {"-h", "--help"}:
        print(format_overview())
        return 0 if arguments else 2
    if arguments[0] == "--version":
        print(f"nas_data {__version__}")
        return 0
    name, rest = split(arguments)
    if name is None:
        return answer_unknown(arguments)
    return run(name, rest)


def parse(name: str, rest: list[str]) -> "Command":
    """Parse a command's options.

    Raises:
        OptionError: options are missing or unknown, and the output is JSON.
        SystemExit: the same, after tyro has printed its message; or help was requested.
    """
    import tyro

    from nas_data.commands._help import describe_options

    kind, captured = load_command_class(name), io.StringIO()
    redirected = contextlib.redirect_stderr(captured) if "--json" in rest else contextlib.nullcontext()
    try:
        with redirected:
            return tyro.cli(
                describe_options(kind),
                args=kind.normalise_arguments(rest),
                prog=f"nas {name}",
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if stop.code and captured.getvalue():
            raise OptionError(f"{strip_box(captured.getvalue())}; see: nas {name} --help") from None
        raise


def strip_box(text: str) -> str:
    """Return the message of one of tyro's boxes as one line, without frame, title and help texts."""
    inside = [line.strip("│ ╭╮╰╯─") and line[2:].rstrip("│ ") for line in text.splitlines()[1:]]
    above = itertools.takewhile(bool, inside)
    shallow = [line.strip() for line in above if len(line) - len(line.lstrip()) <= ARGUMENT]
    return re.sub(r"\s+", " ", " ".join(shallow)).rstrip(".")


def run(name: str, rest: list[str]) -> int:
    """Parse a command's options, run it and print its outcome."""
    try:
        command = parse(name, rest)
    except NasError as error:
        return fail(str(error), as_json=True)
    from nas_data.runs.progress import report_silence

    try:
        with report_silence(f"the start of nas {name}"):
            outcome = command.run()
    except NasError as error:
        return fail(str(error), command.json)
    except OSError as error:  # a full disk or a missing permission cannot be repaired here, only reported
        return fail(describe_refusal(error), command.json)
    except KeyboardInterrupt:
        return fail("interrupted; finished work is kept.", command.json) and 130
    except (ImportError, AttributeError, RuntimeError) as error:
        backend = os.environ.get("MUJOCO_GL")
        if not backend or not is_of_package(error, "mujoco"):
            raise
        remedy = "leave it unset, so that a backend that works is chosen"
        return fail(f"MuJoCo does not start with MUJOCO_GL={backend} ({error}): {remedy}.", command.json)
    from nas_data.typed_json import make_finite

    text = json.dumps(make_finite(outcome.data), indent=2, allow_nan=False) if command.json else outcome.text
    try:
        print(text, flush=True)
    except BrokenPipeError:
        handle_broken_pipe()
    return 0 if outcome.ok else 1
