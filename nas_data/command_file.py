"""Command files: CSV with one column per joint and one row per control step."""

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.errors import JointMismatch, LogError, OptionError

EPISODE = "episode"
SLACK = 1e-6  # [rad or N·m] tolerance of limits, for rounded numbers


def write_commands(path: Path, names: Sequence[str], episodes: Iterable[np.ndarray]) -> None:
    """Write commands so that `read_commands` returns the same numbers.

    Args:
        path: File to write.
        names: Columns, `<joint>.pos` [rad] or `<joint>.effort` [N·m].
        episodes: Commands of each episode, shape (T, n).
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([EPISODE, *names])
        for index, commands in enumerate(episodes):
            writer.writerows([index, *(repr(float(value)) for value in row)] for row in commands)


def read_commands(path: Path, names: Sequence[str]) -> list[np.ndarray]:
    """Read the commands of each episode; rows without an `episode` column are one episode.

    Args:
        path: CSV file with a header.
        names: Columns needed, in the order of the result; others are refused.

    Returns:
        Commands of each episode, shape (T, n), in the file's order.

    Raises:
        LogError: the file is missing or empty, or a cell is not a finite number.
        JointMismatch: the columns are not the robot's commands.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            rows, lines = [], []
            for row in filter(None, reader):
                rows.append(row)
                lines.append(reader.line_num)
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path} cannot be read as a command file ({error}); give a CSV file.") from None
    if len(rows) < 2:
        raise LogError(f"{path} holds no commands; it needs a header ({','.join(names)}) and a row per control step.")
    header = [name.strip() for name in rows[0]]
    _check_columns(path, header, names)
    table = np.array([_parse_row(path, header, line, row) for line, row in zip(lines[1:], rows[1:], strict=True)])
    commands = table[:, [header.index(name) for name in names]]
    if EPISODE not in header:
        return [commands]
    labels = table[:, header.index(EPISODE)]
    starts = np.flatnonzero(np.concatenate([[True], labels[1:] != labels[:-1]]))
    if len(set(labels[starts])) < len(starts):
        raise LogError(f"{path}: the rows of an episode are not contiguous; sort the file by its '{EPISODE}' column.")
    return np.split(commands, starts[1:])


def check_limits(
    path: Path, names: Sequence[str], episodes: Iterable[np.ndarray], low: np.ndarray, high: np.ndarray
) -> None:
    """Refuse commands beyond a robot's limits (n,), naming the first line.

    Raises:
        OptionError: a command lies outside.
    """
    line = 2  # the first is the header
    for commands in episodes:
        outside = np.argwhere((commands < low - SLACK) | (commands > high + SLACK))
        if len(outside):
            step, joint = outside[0]
            hint = (
                ""
                if names[joint].endswith(".effort") or abs(commands[step, joint]) < 2 * math.pi
                else ("; is the file in degrees?")
            )
            raise OptionError(
                f"{path}, line {line + step}: {names[joint]} is {commands[step, joint]:g}, outside the robot's limits "
                f"{low[joint]:g} … {high[joint]:g}{hint}"
            )
        line += len(commands)


def _check_columns(path: Path, header: Sequence[str], names: Sequence[str]) -> None:
    missing = [name for name in names if name not in header]
    unknown = [name for name in header if name not in names and name != EPISODE]
    if missing or unknown or len(set(header)) < len(header):
        raise JointMismatch(
            f"{path} has the columns {', '.join(header)}; it needs {', '.join(names)} and, optionally, '{EPISODE}'."
        )


def _parse_row(path: Path, header: Sequence[str], line: int, row: Sequence[str]) -> list[float]:
    if len(row) != len(header):
        raise LogError(f"{path}, line {line} has {count_of(len(row), 'cell')}; the header has {len(header)}.")
    values = []
    for name, cell in zip(header, row, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise LogError(f"{path}, line {line}: {name} is '{cell}'; a finite number is needed.")
        values.append(value)
    return values
