"""Logs to import: a smooth recording whose truth is known, written in any format, and its map."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from nas_data.importing.map import Map
from nas_data.importing.map_file import load_map

REALDATA = Path(__file__).parents[3] / "shared/realdata"
JOINTS = ("shoulder", "elbow")
RATE = 50.0  # [Hz]


@dataclass(frozen=True)
class Motion:
    """A recording in SI: time [s] (N,), position, velocity, command [rad] (N, n)."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    command: np.ndarray
    signals: dict[str, np.ndarray] = field(default_factory=dict)

    def edited(self, **arrays: np.ndarray) -> "Motion":
        return replace(self, **arrays)


def motion(rows: int = 120, joints: int = 2, phase: float = 0.0, amplitude: float = 0.5) -> Motion:
    """Sines of different frequencies; positions follow the command 20 ms late."""
    time = np.arange(rows) / RATE
    frequency = np.linspace(0.7, 1.3, joints) * 2 * np.pi

    def angle(at: np.ndarray) -> np.ndarray:
        return amplitude * np.sin(at[:, None] * frequency + phase + np.arange(joints))

    late = time - 0.02
    velocity = amplitude * frequency * np.cos(late[:, None] * frequency + phase + np.arange(joints))
    return Motion(time, angle(late), velocity, angle(time))


def columns_of(recording: Motion) -> dict[str, np.ndarray]:
    """The usual columns of a log."""
    return {
        "t": recording.time,
        "q": recording.position,
        "dq": recording.velocity,
        "goal": recording.command,
        **recording.signals,
    }


def write_log(path: Path, columns: dict[str, np.ndarray], constants: dict[str, object] | None = None) -> Path:
    """Write columns in the format that the path's ending names; vectors as JSON cells, lists or 2-D arrays."""
    constants = constants or {}
    if path.suffix == ".npz":
        np.savez(path, **columns, **{key: np.array(value) for key, value in constants.items()})
    elif path.suffix == ".json":
        lists = {key: values.tolist() for key, values in columns.items()}
        rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
        path.write_text(json.dumps({**constants, "rows": rows}))
    elif path.suffix == ".parquet":
        arrays = {key: pa.array(values.tolist()) for key, values in columns.items()}
        metadata = {key: str(value) for key, value in constants.items()}
        pa.parquet.write_table(pa.table(arrays).replace_schema_metadata(metadata), path)
    else:
        cells = {key: _cells(values) for key, values in columns.items()}
        lines = [",".join(cells), *(",".join(row) for row in zip(*cells.values(), strict=True))]
        path.write_text("\n".join(lines) + "\n")
    return path


def _cells(values: np.ndarray) -> list[str]:
    return [repr(value) if values.ndim == 1 else f'"{json.dumps(value)}"' for value in values.tolist()]


def map_text(suffix: str = ".npz", extra: str = "", **changes: str) -> str:
    """A map for `write_log(columns_of(…))`; changes replace values by their dotted keys with _ for the dot."""
    values = {
        "format": f'"{suffix[1:]}"',
        "joints": json.dumps(list(JOINTS)),
        "rate": str(RATE),
        "alignment": '"action_follows_state"',
        "velocity": '"measured"',
        "time": 'column = "t"\nunit = "s"',
        "position": 'column = "q"\nunit = "rad"',
        "register": 'column = "dq"\nunit = "rad/s"',
        "command": 'column = "goal"\nunit = "rad"',
        "top": 'entries = "rows"' if suffix == ".json" else "",
    } | changes
    return f"""
format = {values["format"]}
robot = "sample"
joints = {values["joints"]}
rate = {values["rate"]}
alignment = {values["alignment"]}
velocity = {values["velocity"]}
{values["top"]}
[read.time]
{values["time"]}
[read.position]
{values["position"]}
[read.velocity]
{values["register"]}
[read.command]
{values["command"]}
{extra}
"""


def write_map(folder: Path, text: str | None = None) -> Path:
    path = folder / "map.toml"
    path.write_text(map_text() if text is None else text)
    return path


def sample_map(folder: Path, *args: str, **changes: str) -> Map:
    return load_map(write_map(folder, map_text(*args, **changes)))
