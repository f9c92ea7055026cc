"""A log that is refused is imported once the log or the map is changed as the sentence says."""

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import ARM, write_calibration

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, make_position_feature
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.write import write

Write = Callable[[], object]
FILES = '[files]\nstate = "state.npz"\ncontrol = "control.npz"\n[join]\nmethod = "nearest"\ntolerance = 0.05'
IN_STATE = {"position": 'file = "state"\ncolumn = "q"\nunit = "rad"',
            "register": 'file = "state"\ncolumn = "dq"\nunit = "rad/s"'}  # fmt: skip
IN_CONTROL = {"command": 'file = "control"\ncolumn = "goal"\nunit = "rad"'}
NAMED = 'joint_names = "names"'
DATES = np.datetime64("2026-01-15T10:28:10") + (np.arange(120) * 20_000).astype("timedelta64[us]")
SAMPLE = columns_of(motion())


@dataclass(frozen=True)
class Remedy:
    """A map and a writer of the log."""

    map: str
    write: Write


@dataclass(frozen=True)
class Refusal:
    """What a sentence says of a log, and each remedy that it names."""

    said: str
    refused: Remedy
    remedies: tuple[Remedy, ...]
    log: str = "log"


def place(path: str) -> Path:
    """Make the folder of a file."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    return Path(path)


def npz(path: str = "log/log.npz", rows: int = 120, **changes: np.ndarray | None) -> Write:
    """A writer of the sample columns, some of them changed or, as None, left out."""
    columns = {key: column[:rows] for key, column in SAMPLE.items()} | changes
    kept = {key: column for key, column in columns.items() if column is not None}
    return lambda: write_log(place(path), kept)


def parquet(kept: slice = slice(None), **changes: object) -> Write:
    """A writer of the sample rows, with columns of any type of Arrow."""
    columns = {key: pa.array(column.tolist()) for key, column in SAMPLE.items()}
    columns |= {key: column if isinstance(column, pa.Array) else pa.array(column) for key, column in changes.items()}
    rows = np.arange(120)[kept]
    return lambda: pq.write_table(pa.table(columns).take(rows), place("log/log.parquet"))


def csv(**changes: np.ndarray) -> Write:
    return lambda: write_log(place("log/log.csv"), SAMPLE | changes)


def text(name: str, content: str | bytes) -> Write:
    """A writer of a file whose content is given."""
    data = content if isinstance(content, bytes) else content.encode()
    return lambda: place(f"log/{name}").write_bytes(data)


def both(*writers: Write) -> Write:
    return lambda: [write() for write in writers]


def state_and_control(rows: int, state: Mapping[str, np.ndarray] | None = None, time: bool = True) -> Write:
    """A writer of a log of two files, of which one has some of the commands."""
    without = {} if time else {"t": None}
    held = npz("log/state.npz", 120, goal=None, **without, **(state or {}))
    return both(held, npz("log/control.npz", rows, q=None, dq=None, **without))


def tensors(content: Callable[[], object]) -> Write:
    def write() -> None:
        import torch

        torch.save(content(), place("log/log.pt"))

    return write


def plain_tensors() -> dict[str, object]:
    import torch

    return {key: torch.from_numpy(column) for key, column in SAMPLE.items()}


def lists(values: np.ndarray, **rows: list[float]) -> list[list[float]]:
    """Lists of numbers, some rows replaced: `row9=[0.1]`."""
    return [rows.get(f"row{number}", row) for number, row in enumerate(values.tolist())]


def rarely(values: np.ndarray) -> list[list[float] | None]:
    """Lists of numbers, of which every third is there."""
    return [None if number % 3 else row for number, row in enumerate(values.tolist())]


def held(values: np.ndarray) -> list[list[float]]:
    """The same, each repeated until the next one."""
    return [values[number - number % 3].tolist() for number in range(len(values))]


def derived(suffix: str, **changes: str) -> str:
    written = map_text(suffix, velocity='"derive"', **changes)
    return written.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', "")


def gain(name: str, suffix: str = ".npz") -> str:
    return map_text(suffix, f'[signals.gain]\nconstant = "{name}"\nunit = "1"')


def load(column: str) -> str:
    return map_text(extra=f'[signals.load]\n{column}\nunit = "1"\n')


def positions(column: str, suffix: str = ".npz") -> str:
    return map_text(suffix, position=f'{column}\nunit = "rad"')


def episode(column: str, **changes: str) -> str:
    return map_text(extra=f"[read.episode]\n{column}", **changes)


def clock(unit: str, column: str = "t") -> str:
    return map_text(time=f'column = "{column}"\nunit = "{unit}"')


def named(suffix: str, joints: str = '["shoulder", "elbow"]', **changes: str) -> str:
    return derived(suffix, joints=joints, top=NAMED, **changes)


LOAD = '[signals.load]\ncolumn = "load"\nunit = "1"\n'
COLUMN_Q, ANGLE = 'column = "q"', 'column = "angle"'
WHOLE = npz()
TWO_FILES = map_text(top=FILES, **IN_STATE, **IN_CONTROL)
NO_CLOCK = map_text(top=FILES, time="uniform = true", **IN_STATE, **IN_CONTROL)
TAKE, TAKES = np.repeat([0, 1], 60), np.repeat([[0, 1]], 120, axis=0)
NAMES = [["shoulder", "elbow"]] * 120
ONE_OTHER = [["shoulder", "knee"] if row == 70 else names for row, names in enumerate(NAMES)]

REFUSALS = {
    "objects": Refusal(
        "log.npz: 'q' holds Python objects, which are not read from files; save it as numbers, for example with "
        "astype(float).",
        Remedy(map_text(), npz(q=SAMPLE["q"].astype(object))),
        (Remedy(map_text(), npz(q=SAMPLE["q"].astype(object).astype(float))),),
    ),
    "dimensions": Refusal(
        "the array 'q' has 3 dimensions of float64; save it as numbers in one or two dimensions, or name another.",
        Remedy(map_text(), npz(q=SAMPLE["q"][:, :, None], angle=SAMPLE["q"])),
        (Remedy(map_text(), WHOLE), Remedy(positions(ANGLE), npz(q=SAMPLE["q"][:, :, None], angle=SAMPLE["q"]))),
    ),
    "texts": Refusal(
        "the array 'q' has 2 dimensions of <U32; save it as numbers",
        Remedy(map_text(), npz(q=SAMPLE["q"].astype(str))),
        (Remedy(map_text(), npz(q=SAMPLE["q"].astype(str).astype(float))),),
    ),
    "dates for positions": Refusal(
        "log.parquet: the column 'q' holds timestamp[us], not numbers; name another column.",
        Remedy(map_text(".parquet"), parquet(q=DATES, angle=SAMPLE["q"].tolist())),
        (Remedy(positions(ANGLE, ".parquet"), parquet(q=DATES, angle=SAMPLE["q"].tolist())),),
    ),
    "lists of texts": Refusal(
        "string>, not numbers; name another column.",
        Remedy(map_text(".parquet"), parquet(q=[["here", "there"]] * 120, angle=SAMPLE["q"].tolist())),
        (Remedy(positions(ANGLE, ".parquet"), parquet(q=[["here", "there"]] * 120, angle=SAMPLE["q"].tolist())),),
    ),
    "other lengths": Refusal(
        "and 3 in row 119 (counted from 0); set joint_names = … if a column names the joints of each row, or remove "
        "such rows.",
        Remedy(
            derived(".parquet"),
            parquet(q=lists(SAMPLE["q"], row119=[0.1, 0.2, 0.3]), goal=lists(SAMPLE["goal"]), names=[
                [*names, "hand"] if row == 119 else names for row, names in enumerate(NAMES)]),
        ),
        (
            Remedy(named(".parquet"), parquet(
                q=lists(SAMPLE["q"], row119=[*SAMPLE["q"][119], 9.0]),
                goal=lists(SAMPLE["goal"], row119=[*SAMPLE["goal"][119], 9.0]),
                names=[[*names, "hand"] if row == 119 else names for row, names in enumerate(NAMES)])),
            Remedy(derived(".parquet"), parquet(slice(119))),
        ),
    ),
    "commands that are logged when they change": Refusal(
        "log.parquet: the command is empty, NaN or infinite in rows 1–2, 4–5, 7–8, 10–11, 13–14 and 35 more places "
        "(counted from 0); if it is logged only when it changes, repeat the last one in these rows; else remove them.",
        Remedy(map_text(".parquet"), parquet(goal=rarely(SAMPLE["goal"]))),
        (Remedy(map_text(".parquet"), parquet(goal=held(SAMPLE["goal"]))),),
    ),
    "commands by name that are logged when they change": Refusal(
        "repeat the last one in these rows; else remove them.",
        Remedy(named(".parquet"), parquet(goal=rarely(SAMPLE["goal"]), names=NAMES)),
        (Remedy(named(".parquet"), parquet(goal=held(SAMPLE["goal"]), names=NAMES)),),
    ),
    "signals that are logged less often": Refusal(
        "(counted from 0); if it is logged less often, repeat the last one in these rows; else remove [signals.load].",
        Remedy(map_text(".parquet", LOAD), parquet(load=rarely(SAMPLE["goal"]))),
        (
            Remedy(map_text(".parquet", LOAD), parquet(load=held(SAMPLE["goal"]))),
            Remedy(map_text(".parquet"), parquet(load=rarely(SAMPLE["goal"]))),
        ),
    ),
    "no commands": Refusal(
        "'goal' is empty in all rows; name another column in [read.command].",
        Remedy(map_text(".parquet"), parquet(goal=[None] * 120, target=SAMPLE["goal"].tolist())),
        (
            Remedy(
                map_text(".parquet", command='column = "target"\nunit = "rad"'),
                parquet(goal=[None] * 120, target=SAMPLE["goal"].tolist()),
            ),
        ),
    ),
    "no velocities": Refusal(
        "remove the empty rows, or do not use this column (of velocities: velocity = 'derive').",
        Remedy(map_text(".parquet"), parquet(dq=lists(SAMPLE["dq"], row0=[]))),
        (
            Remedy(map_text(".parquet"), parquet(slice(1, None), dq=lists(SAMPLE["dq"], row0=[]))),
            Remedy(derived(".parquet"), parquet(dq=lists(SAMPLE["dq"], row0=[]))),
        ),
    ),
    "vectors for times": Refusal(
        "the time column 't' holds vectors of 2; write one number per row, or name another column in [read.time].",
        Remedy(map_text(), npz(t=np.column_stack([SAMPLE["t"]] * 2), clock=SAMPLE["t"])),
        (
            Remedy(map_text(), WHOLE),
            Remedy(clock("s", "clock"), npz(t=np.column_stack([SAMPLE["t"]] * 2), clock=SAMPLE["t"])),
        ),
    ),
    "dates for times": Refusal(
        "the time column 't' holds dates or durations; set unit = 'datetime' instead of 's'.",
        Remedy(map_text(), npz(t=DATES)),
        (Remedy(clock("datetime"), npz(t=DATES)),),
    ),
    "numbers for dates": Refusal(
        "holds no dates, such as '0.0'; write them as 2025-12-31T23:59:59.25, or as numbers, with their unit.",
        Remedy(clock("datetime"), WHOLE),
        (Remedy(map_text(), WHOLE), Remedy(clock("datetime"), npz(t=DATES))),
    ),
    "no constant": Refusal(
        "log.npz has no constant 'kp', which the map names; it holds: ",
        Remedy(gain("kp"), npz(gain=np.array(3.0))),
        (Remedy(gain("gain"), npz(gain=np.array(3.0))),),
    ),
    "constant text": Refusal(
        "log.npz: the constant 'kp' is 'stiff', not a number; name a number in the map.",
        Remedy(gain("kp"), npz(kp=np.array("stiff"), gain=np.array(3.0))),
        (Remedy(gain("gain"), npz(kp=np.array("stiff"), gain=np.array(3.0))),),
    ),
    "vector among columns": Refusal(
        "'q' does not have one number per row, unlike the other columns named with it; name columns with one number "
        "per row in 'columns', or one of vectors in 'column'.",
        Remedy(positions('columns = ["q", "q2"]'), npz(q1=SAMPLE["q"][:, 0], q2=SAMPLE["q"][:, 1])),
        (
            Remedy(positions('columns = ["q1", "q2"]'), npz(q1=SAMPLE["q"][:, 0], q2=SAMPLE["q"][:, 1])),
            Remedy(positions(COLUMN_Q), WHOLE),
        ),
    ),
    "component beyond": Refusal(
        "'q' has 2 components, but the map picks number 2 (they count from 0); correct 'components'.",
        Remedy(positions('column = "q"\ncomponents = [1, 2]'), WHOLE),
        (Remedy(positions('column = "q"\ncomponents = [0, 1]'), WHOLE),),
    ),
    "other joints": Refusal(
        "'q' has 2 numbers a row, but the map has 3 joints; correct 'joints', or pick with 'components'.",
        Remedy(map_text(joints='["shoulder", "elbow", "hand"]'), WHOLE),
        (Remedy(map_text(), WHOLE),),
    ),
    "rows unlike times": Refusal(
        "log.npz: 'goal' has 119 rows, but its times are 120; they must be equally many.",
        Remedy(map_text(), npz(goal=SAMPLE["goal"][:119])),
        (Remedy(map_text(), WHOLE),),
    ),
    "register": Refusal(
        "so it is no int16 register read as unsigned; remove 'encoding' from the map.",
        Remedy(load('column = "load"\nencoding = "int16"'), npz(load=np.full((120, 2), -3))),
        (Remedy(load('column = "load"'), npz(load=np.full((120, 2), -3))),),
    ),
    "few rows": Refusal(
        "the episode of rows 0–1 (counted from 0) has only 2 rows; at least 3 are needed, so it is left out, "
        "and nothing remains.",
        Remedy(map_text(), npz(rows=2)),
        (Remedy(map_text(), npz(rows=118)),),
    ),
    "files without times": Refusal(
        "log: the files are read without times but have different numbers of rows (state.npz 120, control.npz 115); "
        "give them equally many rows, or name their time column in [read.time].",
        Remedy(NO_CLOCK, state_and_control(115)),
        (Remedy(NO_CLOCK, state_and_control(120)), Remedy(TWO_FILES, state_and_control(115))),
    ),
    "a file out of order": Refusal(
        "control.npz: the time decreases or is not a number in rows 1–119 (counted from 0); sort or repair the file.",
        Remedy(
            TWO_FILES,
            both(state_and_control(120), npz("log/control.npz", 120, q=None, dq=None, t=SAMPLE["t"][::-1])),
        ),
        (Remedy(TWO_FILES, state_and_control(120)),),
    ),
    "no column of an episode": Refusal(
        "one value a row; name such a column in [read.episode].",
        Remedy(episode('column = "takes"'), npz(takes=TAKES, take=TAKE)),
        (Remedy(episode('column = "take"'), npz(takes=TAKES, take=TAKE)),),
    ),
    "episodes in another file": Refusal(
        "control.npz: the episode column must stand in the file with the positions",
        Remedy(
            episode('file = "control"\ncolumn = "goal"', top=FILES, **IN_STATE, **IN_CONTROL),
            state_and_control(120, {"take": TAKE}),
        ),
        (
            Remedy(
                episode('file = "state"\ncolumn = "take"', top=FILES, **IN_STATE, **IN_CONTROL),
                state_and_control(120, {"take": TAKE}),
            ),
        ),
    ),
    "a folder": Refusal(
        "all/log.npz is a folder, but the map reads single npz files; give the files.",
        Remedy(map_text(), npz("all/log.npz/part.npz")),
        (Remedy(map_text(), npz("log/part.npz")),),
        log="all",
    ),
    "no folder": Refusal(
        "log/state.npz is not a folder, but the map reads state.npz, control.npz from a folder; give the folder.",
        Remedy(TWO_FILES, state_and_control(120)),
        (Remedy(TWO_FILES, state_and_control(120)),),
        log="log/state.npz",
    ),
    "no joint in a row": Refusal(
        "row 70 (counted from 0) lacks the joint 'elbow'; it has shoulder, knee. A row must have all joints of the map "
        "or none: remove this one from 'joints', or write its rows together with the others'.",
        Remedy(named(".parquet"), parquet(names=ONE_OTHER)),
        (
            Remedy(named(".parquet", '["shoulder"]'), parquet(names=ONE_OTHER)),
            Remedy(named(".parquet"), parquet(names=NAMES)),
        ),
    ),
    "torch's other objects": Refusal(
        "log.pt is damaged, or holds more than tensors, numbers and texts; save plain tensors: torch.save({'q': q, "
        "'t': t}, path).",
        Remedy(map_text(".pt"), tensors(lambda: {**plain_tensors(), "path": Path()})),
        (Remedy(map_text(".pt"), tensors(plain_tensors)),),
    ),
    "torch's list": Refusal(
        "log.pt holds a list, not tensors by their names; save plain tensors: torch.save({'q': q, 't': t}, path).",
        Remedy(map_text(".pt"), tensors(lambda: list(plain_tensors().values()))),
        (Remedy(map_text(".pt"), tensors(plain_tensors)),),
    ),
    "latin-1 below the header": Refusal(
        "log.csv cannot be read as csv: it is not in UTF-8; save it in that encoding.",
        Remedy(map_text(".csv"), text("log.csv", "t,name\n0,Gerät\n".encode("latin-1"))),
        (Remedy(map_text(".csv"), csv()),),
    ),
    "no archive": Refusal(
        "log.npz is not an NPZ archive; write it with numpy.savez.",
        Remedy(map_text(), text("log.npz", "t,q\n")),
        (Remedy(map_text(), WHOLE),),
    ),
    "no Parquet": Refusal(
        "log.parquet cannot be read as parquet: it is not a Parquet file; give one, or correct 'format'.",
        Remedy(map_text(".parquet"), text("log.parquet", "t,q\n")),
        (Remedy(map_text(".parquet"), parquet()), Remedy(map_text(".csv"), csv())),
        ),
    "JSON rows": Refusal(
        'log.json holds no list of objects as rows; each row must be an object like {"time": 0.0}.',
        Remedy(map_text(".json"), text("log.json", '{"rows": [[0, 1]]}')),
        (Remedy(map_text(".json"), npz("log/log.json")),),
    ),
    "JSON number": Refusal(
        "write an object of columns, or a list of rows.",
        Remedy(map_text(".json"), text("log.json", "3")),
        (Remedy(map_text(".json"), npz("log/log.json")),),
    ),
}  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def import_log(folder: Path, remedy: Remedy, log: str, out: str) -> int:
    for root in ("log", "all"):
        shutil.rmtree(root, ignore_errors=True)
    remedy.write()
    write_map(folder, remedy.map)
    return main(["import", log, "--map", "map.toml", "--out", out])


@pytest.mark.parametrize("name", REFUSALS)
def test_a_log_is_imported_once_it_is_changed_as_is_said(here, capsys, name):
    refusal = REFUSALS[name]
    assert import_log(here, refusal.refused, refusal.log, "never") == 2
    said = capsys.readouterr().err
    assert refusal.said in said, said
    for number, remedy in enumerate(refusal.remedies):
        assert import_log(here, remedy, "log", f"done{number}") == 0, capsys.readouterr().err


def without_row(number: int) -> Callable[[bytes], bytes]:
    """Return a function that removes a line of a text."""
    return lambda content: b"".join(line for row, line in enumerate(content.splitlines(keepends=True)) if row != number)


def with_cell(row: int, old: str, new: str) -> Callable[[bytes], bytes]:
    """Return a function that changes a line of a text."""

    def change(content: bytes) -> bytes:
        lines = content.decode().splitlines(keepends=True)
        lines[row] = re.sub(old, new, lines[row], count=1)
        return "".join(lines).encode()

    return change


def whole(content: bytes) -> bytes:
    return content


LAST = 120  # line of the last row
VECTOR = r'"\[[^"]*"'
AS_NUMPY = (rb'\[([^",]*), ([^",]*)\]', rb"[\1 \2]")  # how NumPy prints an array
BROKEN = {
    "empty": (".csv", lambda content: b"", "log.csv is empty; give a log with recorded rows.", whole),
    "header only": (
        ".csv",
        lambda content: content.splitlines()[0] + b"\n",
        "holds no rows; give a log with recorded rows.",
        whole,
    ),
    "cut archive": (
        ".npz",
        lambda content: content[:-100],
        "log.npz is cut off: its last part is missing; copy it again from where it was recorded.",
        whole,
    ),
    "damaged archive": (
        ".npz",
        lambda content: content[:300] + bytes(40) + content[340:],
        "restore it from a copy.",
        whole,
    ),
    "cut Parquet": (
        ".parquet",
        lambda content: content[:-50],
        "log.parquet is cut off: its end is missing; copy it again, or let the recorder close its file.",
        whole,
    ),
    "cut JSON": (
        ".json",
        lambda content: content[:-40],
        "log.json is cut off in line 1; copy it again, or let the recorder close its file.",
        whole,
    ),
    "JSON": (
        ".json",
        lambda content: content.replace(b",", b";", 1),
        "is not valid JSON; repair it there.",
        whole,
    ),
    "JSON in UTF-16": (
        ".json",
        lambda content: content.decode().encode("utf-16"),
        "log.json cannot be read as json: it is not in UTF-8; save it in that encoding.",
        whole,
    ),
    "word": (".csv", with_cell(LAST, r"^[^,]+", "soon"), "holds 'soon' in row 119", without_row(LAST)),
    "short list": (
        ".csv",
        with_cell(LAST, VECTOR, '"[0.1]"'),
        "a JSON list of 2 numbers is needed in every row.",
        without_row(LAST),
    ),
    "arrays as NumPy prints them": (
        ".csv",
        lambda content: re.sub(*AS_NUMPY, content),
        "commas are missing between the numbers: write [-0.043",
        whole,
    ),
    "numbers as NumPy prints them": (
        ".csv",
        with_cell(1, VECTOR, '"[0., 1.]"'),
        "holds '[0., 1.]' in row 0 (line 2 of log.csv)",
        with_cell(1, VECTOR, '"[0.0, 1.0]"'),
    ),
    "no numbers in lists": (
        ".csv",
        lambda content: re.sub(rb'"\[', b'"[x', content),
        "it is not a list of numbers: name another column, or write JSON lists such as [0.5, 25.2].",
        whole,
    ),
    "no list": (
        ".csv",
        with_cell(LAST, VECTOR, ""),
        "the position is empty, NaN or infinite in row 119 (line 121 of log.csv); remove these rows, or split the log",
        without_row(LAST),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_damaged_log_is_imported_once_it_is_repaired_as_is_said(here, capsys, name):
    suffix, spoil, said, mend = BROKEN[name]
    path = write_log(here / f"log{suffix}", SAMPLE)
    content = path.read_bytes()
    write_map(here, map_text(suffix))
    path.write_bytes(spoil(content))
    assert main(["import", path.name, "--map", "map.toml", "--out", "never"]) == 2
    assert said in (told := capsys.readouterr().err), told
    path.write_bytes(mend(content))
    assert main(["import", path.name, "--map", "map.toml", "--out", "done"]) == 0, capsys.readouterr().err


def test_a_log_of_another_format_is_given_with_its_map_as_is_said(here, capsys):
    write_log(here / "log.csv", SAMPLE)
    write_log(here / "log.npz", SAMPLE)
    write_map(here)
    assert main(["import", "log.csv", "--map", "map.toml", "--out", "never"]) == 2
    assert "says format = 'npz'; give a log of that format, or another map." in capsys.readouterr().err
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "one"]) == 0
    write_map(here, map_text(".csv"))
    assert main(["import", "log.csv", "--map", "map.toml", "--out", "other"]) == 0


def lerobot(joints: tuple[str, ...] = ("j1", "j2")) -> Path:
    """A dataset in degrees, as another tool leaves it."""
    positions = np.degrees(0.5 * np.sin(np.arange(60)[:, None] / 50 * [2.0, 3.0])).astype(np.float32)
    features = {key: make_position_feature(joints) for key in (STATE, ACTION)}
    recorded = Dataset(features, {STATE: positions, ACTION: positions}, np.array([60]), 50.0, "arm2")
    write(recorded, Path("d"), Provenance(how="simulated", robot="arm2", contiguous=True))
    Path("d", layout.PROVENANCE).unlink()
    return Path("d")


IN_DEGREES = """format = "lerobot"
robot = "arm2"
joints = ["j1", "j2"]
alignment = "action_follows_state"
velocity = "derive"
[read.position]
unit = "deg"
[read.command]
unit = "deg"
"""
OPTIONS = {
    "unit": (["d", "--unit", "grad"], "--unit is 'grad'; choose one of: deg", ["d", "--unit", "deg"]),
    "rate": (
        ["d", "--unit", "deg", "--rate", "-1"],
        "--rate is -1; it must be above 0.",
        ["d", "--unit", "deg", "--rate", "50"],
    ),
    "a file of it": (
        ["d/meta/info.json", "--map", "map.toml"],
        "d/meta/info.json is not a LeRobot dataset; give the folder of one.",
        ["d", "--map", "map.toml"],
    ),
    "no log": (
        ["e", "--map", "map.toml"],
        "There is no log e; give recorded files or folders.",
        ["d", "--map", "map.toml"],
    ),
    "no calibration": (
        ["d", "--unit", "range"],
        "--unit range cannot be converted without the calibration: add --calibration FILE",
        ["d", "--unit", "range", "--calibration", "own.json"],
    ),
    "calibration elsewhere": (
        ["d", "--unit", "range", "--calibration", "none.json"],
        "There is no calibration file none.json; LeRobot keeps it in",
        ["d", "--unit", "range", "--calibration", "own.json"],
    ),
    "another file": (
        ["d", "--unit", "range", "--calibration", "arm.xml"],
        "arm.xml is not a calibration file of LeRobot, which has drive_mode, range_min and range_max of each motor",
        ["d", "--unit", "range", "--calibration", "own.json"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OPTIONS)
def test_a_dataset_of_lerobot_is_imported_with_the_options_that_are_named(here, capsys, name):
    wrong, said, right = OPTIONS[name]
    lerobot()
    Path("arm.xml").write_text(ARM)
    Path("map.toml").write_text(IN_DEGREES)
    write_calibration(here / "own.json", ("j1", "j2"))
    for file in (here / "own.json", here / "d" / layout.INFO):
        file.write_text(file.read_text(), encoding="utf-8-sig")  # as Windows' Notepad saves it
    assert main(["import", *wrong, "--out", "never"]) == 2
    assert said in capsys.readouterr().err
    assert main(["import", *right, "--out", "done"]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(
    "mended",
    [
        IN_DEGREES,
        IN_DEGREES.replace('["j1", "j2"]', '["a", "b"]').replace("unit =", 'names = ["j1.pos", "j2.pos"]\nunit ='),
    ],
    ids=["joints", "names"],
)
def test_components_of_other_names_are_named_in_the_map_as_is_said(here, capsys, mended):
    lerobot()
    write_map(here, IN_DEGREES.replace('["j1", "j2"]', '["a", "b"]'))
    assert main(["import", "d", "--map", "map.toml", "--out", "never"]) == 2
    said = capsys.readouterr().err
    assert (
        "has no component 'a.pos'; it has: j1.pos, j2.pos. Name them in 'joints' of the map, or with names = […]"
        in said
    )
    write_map(here, mended)
    assert main(["import", "d", "--map", "map.toml", "--out", "done"]) == 0


def test_a_gripper_takes_its_range_from_the_model_that_is_asked_for(here, capsys):
    lerobot(("j1", "gripper"))
    Path("arm.xml").write_text(ARM.replace('"j2"', '"gripper"'))
    assert main(["import", "d", "--unit", "deg", "--out", "never"]) == 2
    assert "gives as 0 … 100 of its range: add --model MODEL.xml, which has" in capsys.readouterr().err
    assert main(["import", "d", "--unit", "deg", "--model", "arm.xml", "--out", "done"]) == 0


def test_a_dataset_that_was_imported_is_used_as_it_is_by_the_commands_that_are_named(here, capsys):
    lerobot()
    Path("arm.xml").write_text(ARM)
    assert main(["import", "d", "--unit", "deg", "--out", "done"]) == 0
    assert main(["import", "done", "--unit", "deg", "--out", "again"]) == 2
    assert "done is a dataset of nas already; use it as it is (nas info, nas pair, nas gap)." in capsys.readouterr().err
    assert main(["info", "done"]) == 0
    assert main(["pair", "done", "--model", "arm.xml", "--out", "paired"]) == 0
