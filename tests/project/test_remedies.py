"""What an error of importing or of a dataset names as its remedy works: the fault is refused, the remedy is not."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq
import pytest
from support.bag_samples import MAP as BAG_MAP
from support.bag_samples import write_json_mcap, write_rosbag
from support.dataset_samples import recorded
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import ARM, motions, write_calibration, write_lerobot

import nas_data as nas
from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_position_feature
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, OptionError
from nas_data.gap.problem import Problem

OFFLINE = {**os.environ, "HF_HUB_OFFLINE": "1"}


@dataclass(frozen=True)
class Fault:
    """A log and a map that are refused, what the sentence says, and the same with its remedy."""

    said: str
    log: Callable[[Path], Path]
    map: str
    mended_map: str = ""
    mended_log: Callable[[Path], Path] | None = None


def log(suffix: str = ".npz", **edits: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], Path]:
    """A writer of the sample log with some columns changed."""

    def written(folder: Path) -> Path:
        columns = columns_of(motion())
        return write_log(folder / f"log{suffix}", columns | {key: edit(columns[key]) for key, edit in edits.items()})

    return written


def text_log(change: Callable[[str], str], encoding: str = "utf-8") -> Callable[[Path], Path]:
    """A writer of a CSV with one number a cell, its text changed."""

    def written(folder: Path) -> Path:
        recording = motion()
        cells = np.column_stack([recording.time, recording.position, recording.command])
        lines = ["t,q1,q2,c1,c2", *(",".join(map(repr, row)) for row in cells.tolist())]
        path = folder / "log.csv"
        path.write_text(change("\n".join(lines) + "\n"), encoding=encoding)
        return path

    return written


def forty(values: np.ndarray) -> np.ndarray:
    return values * 40


def without_last(values: np.ndarray) -> np.ndarray:
    return np.where(np.arange(120)[:, None] == 119, np.nan, values)


def shorter(folder: Path) -> Path:
    return write_log(folder / "log.npz", {key: values[:119] for key, values in columns_of(motion()).items()})


def with_names(folder: Path) -> Path:
    return write_log(folder / "log.npz", {**columns_of(motion()), "n": np.array(["elbow", "shoulder"])})


def torn(text: str) -> str:
    return text[:-9].rpartition(",")[0] + "\n"


def without_line(text: str) -> str:
    return text[: text[:-1].rfind("\n") + 1]


def german(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


def quoted(text: str) -> str:
    return "\n".join(",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(",")) for line in text.splitlines())


def swapped_rows(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[:50], values[51:52], values[50:51], values[52:]])


def csv_map(**changes: str) -> str:
    text = map_text(".csv", velocity='"derive"', position='columns = ["q1", "q2"]\nunit = "rad"',
                    command='columns = ["c1", "c2"]\nunit = "rad"', **changes)  # fmt: skip
    return text.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', "")


def takes(*numbers: int) -> Callable[[Path], Path]:
    """A writer of a log in three parts, each with the number of its take; parts of one take go on in time."""

    def written(folder: Path) -> Path:
        columns, part = columns_of(motion()), 40
        columns["take"] = np.repeat(numbers, part)
        begins = [part * numbers[:place].count(number) for place, number in enumerate(numbers)]
        chosen = np.concatenate([np.arange(begin, begin + part) for begin in begins])
        return write_log(
            folder / "log.npz", {key: column if key == "take" else column[chosen] for key, column in columns.items()}
        )

    return written


def loaded(folder: Path) -> Path:
    return write_log(folder / "log.npz", {**columns_of(motion()), "load": np.arange(120.0)})


def named_rows(folder: Path) -> Path:
    return write_log(folder / "log.npz", {**columns_of(motion()), "n": np.array([["j1", "j2"], ["j2", "j1"]] * 60)})


DEGREES = {
    "position": 'column = "q"\nunit = "deg"', "register": 'column = "dq"\nunit = "deg/s"',
    "command": 'column = "goal"\nunit = "deg"',
}  # fmt: skip
in_degrees = log(q=np.degrees, dq=np.degrees, goal=np.degrees)
slow = log(t=lambda time: time * 2, dq=lambda values: values / 2)
coarse = log(t=lambda time: np.floor(time * 20 + 1e-9) / 20)
wide = log(q=lambda values: np.hstack([values, values[:, :1]]))
encoded = {"register": 'column = "dq"\nunit = "rad/s"\nencoding = "int16"'}
turns = log(q=forty, dq=forty, goal=forty)
TURNED = 'column = "dq"\nunit = "rad/s"\nsign = -1'
IN_DEGREES = 'column = "dq"\nunit = "deg/s"'
PICKED = 'column = "q"\nunit = "rad"\ncomponents = [0, 1]'
SEMICOLON = 'delimiter = ";"'
COMMA = 'decimal = ","'
GERMAN = f"{SEMICOLON}\n{COMMA}"
ALLOWED = '[audit]\nallow = ["unit_slip"]'
GOAL = 'column = "goal"\nunit = "deg"'
TAKES = map_text(extra='[read.episode]\ncolumn = "take"')
LOAD = map_text(extra='[signals.load]\n{} = "load"\nunit = "1"\nwhole_robot = true')
FAST = "[audit]\nmax_speed = 1e3\n"
FAULTS = {
    "rate": Fault("correct 'rate'", slow, map_text(), map_text(rate="25.0")),
    "resample": Fault(
        "or add [resample]", slow, map_text(), map_text(extra='[resample]\nrate = 25.0\nmethod = "linear"')
    ),
    "coarse clock": Fault("set uniform = true in [read.time]", coarse, map_text(), map_text(time="uniform = true")),
    "readings written several times": Fault(
        "written several times, add [resample]",
        coarse,
        map_text(),
        map_text(extra='[resample]\nrate = 20.0\nmethod = "linear"'),
    ),
    "degrees": Fault("correct the unit in [read.position]", in_degrees, map_text(), map_text(**DEGREES)),
    "turns": Fault(
        "allow = ['unit_slip']", turns, map_text(extra=FAST), map_text(extra=FAST + 'allow = ["unit_slip"]')
    ),
    "radians": Fault("use unit = 'rad' in [read.position]", log(), map_text(**DEGREES), map_text()),
    "few degrees": Fault("add allow = ['unit_slip']", log(), map_text(**DEGREES), map_text(extra=ALLOWED, **DEGREES)),
    "silent register": Fault("velocity = 'derive'", log(dq=np.zeros_like), map_text(), map_text(velocity='"derive"')),
    "sign": Fault("correct 'sign'", log(dq=np.negative), map_text(), map_text(register=TURNED)),
    "register unit": Fault("correct the unit", log(dq=np.degrees), map_text(extra=FAST), map_text(register=IN_DEGREES)),
    "rows": Fault("sort them", log(t=swapped_rows), map_text(), map_text(), log()),
    "order": Fault(
        "name them in this order",
        with_names,
        map_text(top='joint_names = "n"'),
        map_text(top='joint_names = "n"', joints='["elbow", "shoulder"]'),
    ),
    "components": Fault("pick with 'components'", wide, map_text(), map_text(position=PICKED)),
    "encoding": Fault("remove 'encoding' from", log(), map_text(**encoded), map_text()),
    "delimiter": Fault(
        "set delimiter = ';'", text_log(lambda text: text.replace(",", ";")), csv_map(), csv_map(top=SEMICOLON)
    ),
    "comma": Fault("set decimal = ','", text_log(german), csv_map(top=SEMICOLON), csv_map(top=GERMAN)),
    "quoted comma": Fault("set decimal = ','", text_log(quoted), csv_map(), csv_map(top=COMMA)),
    "point": Fault("set decimal = '.'", text_log(str), csv_map(top=COMMA), csv_map()),
    "unquoted comma": Fault(
        "write numbers with a decimal point",
        text_log(lambda text: text.replace(".", ",")),
        csv_map(top=COMMA),
        csv_map(),
        text_log(str),
    ),
    "utf-16": Fault("save it in that encoding", text_log(str, "utf-16"), csv_map(), csv_map(), text_log(str)),
    "twice": Fault(
        "give each its own name",
        text_log(lambda text: text.replace("c2", "c1", 1)),
        csv_map(),
        csv_map(),
        text_log(str),
    ),
    "cut line": Fault("repair or remove it", text_log(torn), csv_map(), csv_map(), text_log(without_line)),
    "clock": Fault("uniform = true", log(), map_text(time=""), map_text(time="uniform = true")),
    "command unit": Fault(
        "correct the unit in [read.command]", log(goal=np.degrees), map_text(), map_text(command=GOAL)
    ),
    "episodes out of order": Fault("sort the rows", takes(0, 1, 0), TAKES, TAKES, takes(0, 0, 1)),
    "episodes with one number": Fault("give each episode its own number", takes(0, 1, 0), TAKES, TAKES, takes(0, 1, 2)),
    "no constant": Fault("give it as 'column'", loaded, LOAD.format("constant"), LOAD.format("column")),
    "names of all rows": Fault(
        "no row names a joint of the map (shoulder, elbow); the first names j1, j2. Use the names of the log in "
        "'joints'",
        named_rows,
        map_text(top='joint_names = "n"'),
        map_text(top='joint_names = "n"', joints='["j1", "j2"]'),
    ),
    "no number": Fault("remove these rows", log(q=without_last), map_text(), map_text(), shorter),
}


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM)
    return tmp_path


@pytest.mark.parametrize("name", FAULTS)
def test_the_remedy_for_a_log_works(here, capsys, name):
    fault = FAULTS[name]
    path = fault.log(here)
    write_map(here, fault.map)
    assert main(["import", path.name, "--map", "map.toml", "--out", "never"]) == 2
    said = capsys.readouterr().err
    assert fault.said in said, said
    path = (fault.mended_log or fault.log)(here)
    write_map(here, fault.mended_map)
    assert main(["import", path.name, "--map", "map.toml", "--out", "done"]) == 0, capsys.readouterr().err


def test_the_tolerance_and_the_method_of_a_join_can_be_changed_as_is_said(here, capsys):
    (here / "log").mkdir()
    columns = columns_of(motion())
    write_log(here / "log/state.csv", {key: columns[key] for key in ("t", "q", "dq")})
    write_log(here / "log/control.csv", {"t": columns["t"][::4], "goal": columns["goal"][::4]})
    top = '[files]\nstate = "state.csv"\ncontrol = "control.csv"\n[join]\nmethod = "{}"\ntolerance = {}'

    def joined(method: str, tolerance: float) -> int:
        text = map_text(
            ".csv",
            top=top.format(method, tolerance),
            position='file = "state"\ncolumn = "q"\nunit = "rad"',
            register='file = "state"\ncolumn = "dq"\nunit = "rad/s"',
            command='file = "control"\ncolumn = "goal"\nunit = "rad"',
        )
        write_map(here, text)
        return main(["import", "log", "--map", "map.toml", "--out", f"{method}{tolerance}"])

    assert joined("nearest", 0.01) == 2
    assert "raise the tolerance of [join], or join with the previous row" in capsys.readouterr().err
    assert joined("nearest", 0.05) == 0 and joined("previous", 0.07) == 0


def test_tables_whose_times_are_in_another_unit_are_joined_as_is_said(here, capsys):
    (here / "log").mkdir()
    columns = columns_of(motion())
    write_log(here / "log/state.csv", {"t": 1e3 * columns["t"], "q": columns["q"], "dq": columns["dq"]})
    write_log(here / "log/control.csv", {"t": 1e3 * columns["t"] + 5, "goal": columns["goal"]})
    changes = {
        "top": '[files]\nstate = "state.csv"\ncontrol = "control.csv"\n[join]\nmethod = "nearest"\ntolerance = 0.01',
        "position": 'file = "state"\ncolumn = "q"\nunit = "rad"',
        "register": 'file = "state"\ncolumn = "dq"\nunit = "rad/s"',
        "command": 'file = "control"\ncolumn = "goal"\nunit = "rad"',
    }
    write_map(here, map_text(".csv", **changes))
    assert "check the unit of [read.time]" in refused(capsys, "import", "log", "--map", "map.toml", "--out", "never")
    write_map(here, map_text(".csv", time='column = "t"\nunit = "ms"', **changes))
    assert main(["import", "log", "--map", "map.toml", "--out", "done"]) == 0


def test_a_joint_that_the_model_lacks_is_named_as_in_the_model(here, capsys):
    write_log(here / "log.npz", columns_of(motion()))
    write_map(here)
    said = refused(capsys, "import", "log.npz", "--map", "map.toml", "--model", "arm.xml", "--out", "never")
    assert "arm.xml has no joint 'shoulder'; it has: j1, j2. Name the joints in 'joints' of the map" in said
    assert not (here / "never").exists()
    write_map(here, map_text(joints='["j1", "j2"]'))
    assert main(["import", "log.npz", "--map", "map.toml", "--model", "arm.xml", "--out", "done"]) == 0


def test_a_measured_joint_that_mimics_another_is_left_out_of_the_map_as_is_said(here, capsys):
    mimic = '<mimic joint="j1" multiplier="-1"/>'
    inertia = '<mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(f'<link name="{name}"><inertial>{inertia}</inertial></link>' for name in ("l1", "l2"))
    joints = "".join(
        f'<joint name="{joint}" type="revolute"><parent link="base"/><child link="{link}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-2" upper="2" effort="2" velocity="5"/>{more}</joint>'
        for joint, link, more in (("j1", "l1", ""), ("j2", "l2", mimic))
    )
    Path("gripper.urdf").write_text(f'<robot name="gripper"><link name="base"/>{links}{joints}</robot>')
    write_log(here / "log.npz", columns_of(motion()))
    write_map(here, map_text(joints='["j1", "j2"]'))
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "both"]) == 0
    said = refused(capsys, "pair", "both", "--model", "gripper.urdf")
    assert "'j2' of gripper.urdf follows 'j1'" in said and "leave it out of 'joints' of the map" in said
    write_map(here, map_text(joints='["j1"]', **{
        key: f'column = "{column}"\ncomponents = [0]\nunit = "{unit}"'
        for key, column, unit in (("position", "q", "rad"), ("register", "dq", "rad/s"), ("command", "goal", "rad"))
    }))  # fmt: skip
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "one"]) == 0
    assert main(["pair", "one", "--model", "gripper.urdf", "--out", "paired"]) == 0


def test_two_joints_that_the_map_takes_for_one_another_are_told_by_the_models_limits(here, capsys):
    """Positions and commands are exchanged alike, so that they agree with each other."""
    ends = ARM.replace('range="-2 2"', 'range="0.4 2"', 1).replace('range="-2 2"', 'range="-1 0.3"', 1)
    Path("ends.xml").write_text(ends)
    columns = columns_of(motion())
    right = {"q": columns["q"] * [0.6, 0.5] + [1.2, -0.4], "goal": columns["goal"] * [0.6, 0.5] + [1.2, -0.4]}
    picked = 'components = {}\nunit = "rad"'
    for name, order in (("right", [0, 1]), ("exchanged", [1, 0])):
        changes = {"position": f'column = "q"\n{picked}', "command": f'column = "goal"\n{picked}'}
        text = map_text(joints='["j1", "j2"]', velocity='"derive"', **{k: v.format(order) for k, v in changes.items()})
        write_map(here, text.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', ""))
        write_log(here / "log.npz", {"t": columns["t"], **right})
        assert main(["import", "log.npz", "--map", "map.toml", "--model", "ends.xml", "--out", name]) == 0
        said = capsys.readouterr().out
        assert ("or whether the map exchanges j1 and j2" in said) is (name == "exchanged"), said
        assert ("model_limits" in said) is (name == "exchanged"), said


ANSWERS = {"late": ("action_follows_state", 1, "state_follows_action"),
           "early": ("state_follows_action", 0, "action_follows_state")}  # fmt: skip


@pytest.mark.parametrize("look", ANSWERS)
def test_commands_that_look_shifted_by_a_row_are_put_right_by_the_alignment_that_is_named(here, capsys, look):
    wrong, later, right = ANSWERS[look]
    rng = np.random.default_rng(0)
    motions_of_arm = [(states[: len(states) - later], np.roll(commands, later, axis=0)[: len(states) - later])
                      for states, commands in motions(6, 80)]  # fmt: skip
    for number, (states, commands) in enumerate(motions_of_arm):
        states = states + rng.normal(0, 1e-4, states.shape)
        write_log(here / f"log{number}.npz", {"t": np.arange(len(states)) / 50, "q": states, "goal": commands})

    def find_shift(alignment: str) -> dict[str, object]:
        text = map_text(joints='["j1", "j2"]', alignment=f'"{alignment}"', velocity='"derive"')
        write_map(here, text.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', ""))
        assert main(["import", *map(str, sorted(here.glob("*.npz"))), "--map", "map.toml", "--out", alignment]) == 0
        capsys.readouterr()
        assert main(["gap", "find", alignment, "--model", "arm.xml", "--json"]) == 0
        audit = json.loads(capsys.readouterr().out)["audit"]
        return next(entry for entry in audit if entry["check"] == "command shift")

    found = find_shift(wrong)
    assert not found["ok"] and f"Commands look 1 row (20 ms) {look}" in found["finding"], found
    assert f"'{right}'" in found["finding"] and "alignment = " in found["finding"]
    assert find_shift(right)["ok"]


# Datasets


def simulated_positions(rows: int, fps: float = 50.0) -> np.ndarray:
    """Sines of two joints [rad], shape (rows, 2)."""
    return (0.5 * np.sin(np.arange(rows)[:, None] / fps * [2.0, 3.0])).astype(np.float32)


def simulated(root: Path, lengths: tuple[int, ...] = (200,), fps: float = 50.0) -> Path:
    """A dataset of the two-joint arm in radians, positions only, as LeRobot's users have it."""
    positions = simulated_positions(sum(lengths), fps)
    features = {key: make_position_feature(("j1", "j2")) for key in (STATE, ACTION)}
    dataset = Dataset(
        features, {STATE: positions, ACTION: positions + np.float32(0.01)}, np.array(lengths), fps, "arm2"
    )
    write(dataset, root, Provenance(how="simulated", robot="arm2", contiguous=True))
    return root


def commands_in(text: str) -> list[list[str]]:
    """The commands that a sentence names, without `nas`."""
    return [
        shlex.split(found) for found in re.findall(r"[`'(]?nas ([a-z]+ [^`';()]+?)[`').;]*(?: first|$|[`')])", text)
    ]


def refused(capsys, *arguments: str) -> str:
    capsys.readouterr()
    assert main(list(arguments)) != 0
    captured = capsys.readouterr()
    return (captured.err + captured.out).strip()


def test_a_dataset_in_memory_is_put_right_in_python(here):
    """Its remedies name no folder, even where it was read from one and changed since."""
    positions = simulated_positions(200)
    one = nas.Dataset.from_arrays(positions, positions + 0.01, rate=50, joints=("j1", "j2"))
    changed = nas.Dataset.load(simulated(here / "two", (100, 100))).select([0])
    for dataset in (one, changed):
        with pytest.raises(DatasetInvalid) as raised:
            nas.identify(dataset, "arm.xml")
        assert "nas split" not in str(raised.value) and str(raised.value).startswith("The dataset has 1 episode")
        assert "a list of arrays, one an episode: numpy.array_split(positions, 2)" in str(raised.value)
        with pytest.raises(DatasetInvalid, match=re.escape('nas_data.pair(dataset, model="MODEL.xml")')):
            nas.train_delta(dataset)
    parts = np.array_split(positions, 2)
    two = nas.Dataset.from_arrays(parts, [part + 0.01 for part in parts], rate=50, joints=("j1", "j2"))
    assert Problem.of(two, "arm.xml", None).names == ("dataset", "arm.xml")
    assert nas.pair(two, model="arm.xml").paired


def test_columns_in_degrees_are_converted_in_python(here):
    degrees = np.degrees(simulated_positions(60)).astype(np.float32)
    features = {key: replace(make_position_feature(("j1", "j2")), units=()) for key in (STATE, ACTION)}
    dataset = Dataset(features, {STATE: degrees, ACTION: degrees}, np.array([60]), 50.0, "arm2")
    with pytest.raises(DatasetInvalid, match=r"numpy.radians\(states\)") as raised:
        nas.pair(dataset, model="arm.xml")
    assert "--map" not in str(raised.value)
    columns = {key: np.radians(column) for key, column in dataset.columns.items()}
    assert nas.pair(replace(dataset, columns=columns), model="arm.xml").paired


@pytest.mark.parametrize(("rows", "seconds"), [(400, "3"), (200, "1.98"), (151, "1.5")])
def test_one_episode_is_cut_by_the_command_that_the_gap_names(here, capsys, rows, seconds):
    simulated(here / "one", (rows,))
    said = refused(capsys, "gap", "find", "one", "--model", "arm.xml")
    (command,) = commands_in(said)
    assert command == ["split", "one", "--seconds", seconds]
    assert main(command) == 0
    assert main(["split", "one", "--seconds", "10"]) == 2, "nothing would be cut"
    assert main(["gap", "find", "datasets/one_cut", "--model", "arm.xml"]) == 0


@pytest.mark.parametrize(
    ("wrong", "said", "right"),
    [
        (["--seconds", "0.02"], "give at least 0.06 s", ["--seconds", "0.06"]),
        (["--seconds", "2"], "give at most 1 s", ["--seconds", "1"]),
        (["--episodes", "0,7"], "it has 0 to 2", ["--episodes", "0,2"]),
        (["--episodes", "0,0"], "name each once", ["--episodes", "0"]),
        (["--episodes", "2-1"], "write the smaller number first, like 4-7", ["--episodes", "1-2"]),
        (["--episodes", "0,1,2"], "both parts need at least one", ["--episodes", "0,1"]),
        (["--share", "1.5"], "for example 0.8", ["--share", "0.8"]),
        (["--share", "0.8", "--seed", "-1"], "must be 0 or more", ["--share", "0.8", "--seed", "0"]),
    ],
)
def test_a_dataset_is_divided_as_the_refusal_says(here, capsys, wrong, said, right):
    write(recorded(lengths=(100, 100, 100)), here / "d", Provenance(how="simulated", robot="ergojr"))
    names = ["--name", "parts"] if "--seconds" in wrong else ["--names", "one", "other"]
    assert said in refused(capsys, "split", "d", *wrong, *names)
    assert main(["split", "d", *right, *names]) == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda motors: {"other": motors["j1"], "j2": motors["j2"]}, "has no motor 'j1'; it has: other, j2"),
        (lambda motors: {**motors, "j1": {**motors["j1"], "range_max": 0}}, "has an empty range for 'j1'"),
    ],
)
def test_a_calibration_of_another_robot_is_refused_and_ones_own_taken(here, capsys, change, said):
    pytest.importorskip("lerobot")
    motors = write_calibration(here / "own.json", ("j1", "j2"))
    (here / "wrong.json").write_text(json.dumps(change(motors)))
    write_lerobot(here / "d", [(states * 50, commands * 50) for states, commands in motions()])
    unit = ["--unit", "range", "--calibration"]
    assert said in refused(capsys, "import", "d", *unit, "wrong.json", "--out", "made")
    assert main(["import", "d", *unit, "own.json", "--out", "made"]) == 0


def test_arrays_of_another_shape_or_without_a_rate_are_put_right_as_is_said():
    positions = [simulated_positions(40)]
    with pytest.raises(OptionError, match="give the control rate"):
        nas.Dataset.from_arrays(positions, positions, rate=0, joints=["j1", "j2"])
    with pytest.raises(DatasetInvalid, match="a column a joint"):
        nas.Dataset.from_arrays([positions[0][:, :1]], positions, rate=50, joints=["j1", "j2"])
    assert nas.Dataset.from_arrays(positions, positions, rate=50, joints=["j1", "j2"]).n_frames == 39


def test_a_map_of_a_bag_names_its_topics_as_is_said(here, capsys):
    write_json_mcap(here / "bag.mcap")
    text = BAG_MAP.format(format="mcap")
    topics = text[text.index("[topics]") : text.index("[join]")]
    write_map(here, text.replace(topics, ""))
    assert "[topics] is missing; name the topics to read" in refused(capsys, "import", "bag.mcap", "--map", "map.toml")
    write_map(here, text)
    assert main(["import", "bag.mcap", "--map", "map.toml", "--out", "made"]) == 0


def foreign(root: Path, fps: float = 50.0, gripper: bool = False) -> Path:
    """The dataset as another tool would have left it; with a gripper it is in degrees and per cent."""
    positions, joints = simulated_positions(200, fps), ("j1", "gripper" if gripper else "j2")
    if gripper:
        positions = positions * np.float32([180 / np.pi, 80]) + np.float32([0, 50])
    features = {key: make_position_feature(joints) for key in (STATE, ACTION)}
    dataset = Dataset(features, {STATE: positions, ACTION: positions + np.float32(0.01)}, np.array([200]), fps, "arm2")
    write(dataset, root, Provenance(how="simulated", robot="arm2", contiguous=True))
    (root / layout.PROVENANCE).unlink()
    return root


def test_datasets_of_two_rates_are_imported_one_at_a_time(here, capsys):
    foreign(here / "a")
    foreign(here / "b", fps=30.0)
    (here / "own.toml").write_text(
        'format = "lerobot"\nrobot = "arm2"\njoints = ["j1", "j2"]\nalignment = "action_follows_state"\n'
        'velocity = "derive"\n[read.position]\nunit = "rad"\n[read.command]\nunit = "rad"\n'
    )
    said = refused(capsys, "import", "a", "b", "--map", "own.toml", "--out", "never")
    assert "b runs at 30 Hz, a at 50 Hz; import them one at a time" in said
    for name in ("a", "b"):
        assert main(["import", name, "--map", "own.toml", "--out", f"done_{name}"]) == 0


def test_a_gripper_without_a_range_is_given_one_in_the_model(here, capsys):
    foreign(here / "d", gripper=True)
    text = ARM.replace('"j2"', '"gripper"')
    Path("arm.xml").write_text(text.replace('armature="0.002" range="-2 2"/>\n<geom type="capsule" fromto="0 0 0 0.1',
                                            'armature="0.002"/>\n<geom type="capsule" fromto="0 0 0 0.1'))  # fmt: skip
    command = ("import", "d", "--unit", "deg", "--model", "arm.xml", "--out", "done")
    assert "has no joint 'gripper' with a range; give one in the model" in refused(capsys, *command)
    Path("arm.xml").write_text(text)
    assert main(list(command)) == 0


def test_parts_that_no_episode_has_are_made_as_short_as_is_said(here, capsys):
    simulated(here / "one", (151,))
    (most,) = re.findall(r"give at most ([\d.]+) s", refused(capsys, "split", "one", "--seconds", "2"))
    assert main(["split", "one", "--seconds", most]) == 0


def test_next_positions_that_belong_to_nothing_are_left_out():
    positions = simulated_positions(60)
    features = {key: make_position_feature(("j1", "j2")) for key in (STATE, ACTION, NEXT_STATE)}
    columns = {STATE: positions, ACTION: positions, NEXT_STATE: positions + 0.1}
    dataset = Dataset(features, columns, np.array([60]), 50.0, "arm2")
    with pytest.raises(DatasetInvalid, match="or leave the feature out"):
        as_transitions(dataset)
    kept = {key: features[key] for key in (STATE, ACTION)}
    as_transitions(replace(dataset, features=kept, columns={key: columns[key] for key in kept}))


def test_datasets_of_two_rates_are_merged_once_they_are_imported_at_one(here, capsys):
    for name, phase in (("a", 0.0), ("b", 1.0)):
        write_log(here / f"{name}.npz", columns_of(motion(phase=phase)))

    def import_at(rates: str) -> None:
        for name, rate in zip("ab", rates.split(), strict=True):
            write_map(here, map_text(extra=f'[resample]\nrate = {rate}\nmethod = "linear"'))
            assert main(["import", f"{name}.npz", "--map", "map.toml", "--out", f"{name}{rate}"]) == 0

    import_at("50.0 25.0")
    assert "record or import them at one rate" in refused(capsys, "merge", "a50.0", "b25.0", "--out", "never")
    import_at("25.0 50.0")
    assert main(["merge", "a25.0", "b25.0", "--out", "done"]) == 0


def test_a_dataset_with_a_link_is_packed_once_it_has_the_file(here, capsys):
    root = simulated(here / "d", (60, 60))
    (here / "notes.txt").write_text("red arm")
    (root / "notes.txt").symlink_to(here / "notes.txt")
    assert "put the file itself there" in refused(capsys, "pack", "d", "--out", "p.nas.tar")
    (root / "notes.txt").unlink()
    shutil.copy(here / "notes.txt", root)
    assert main(["pack", "d", "--out", "p.nas.tar"]) == 0


TORQUES = ARM.replace('<position joint="j1" kp="2" kv="0.1"/>', '<motor joint="j1"/>')


@pytest.mark.parametrize(
    ("model", "said", "mended", "more"),
    [
        (TORQUES, "give its actuator a ctrlrange", TORQUES.replace("<motor ", '<motor ctrlrange="-0.1 0.1" '), ()),
        (TORQUES, "play a file of commands (--commands)", TORQUES, ("--commands", "commands.csv")),
        (ARM.replace('"j1" kp', '"j1" gear="0" kp'), "gear of 0", ARM, ()),
    ],
    ids=["ctrlrange", "commands", "gear"],
)
def test_a_model_whose_commands_cannot_be_made_is_mended_as_is_said(here, capsys, model, said, mended, more):
    Path("commands.csv").write_text("j1.effort,j2.pos\n" + "0.01,0.2\n" * 40)
    record = ("record", "sim", "--robot", "arm.xml", "--episodes", "1", "--seconds", "0.5", "--out", "done")
    Path("arm.xml").write_text(model)
    assert said in refused(capsys, *record)
    Path("arm.xml").write_text(mended)
    assert main([*(word for word in record if not more or word not in ("--seconds", "0.5")), *more]) == 0


def test_one_log_is_cut_while_it_is_imported(here):
    write_log(here / "log.npz", columns_of(motion(rows=400)))
    write_map(here)
    assert main(["import", "log.npz", "--map", "map.toml", "--cut", "3", "--out", "done"]) == 0
    assert main(["split", "done", "--seconds", "0.01"]) == 2


def test_takes_that_follow_each_other_in_one_log_are_told_apart_by_the_column_that_the_message_asks_for(here, capsys):
    takes = columns_of(motion())
    twice = {key: np.concatenate([values, values]) for key, values in takes.items()}
    twice["take"] = np.repeat([0, 1], len(takes["t"]))
    write_log(here / "log.npz", twice)
    write_map(here)
    said = refused(capsys, "import", "log.npz", "--map", "map.toml", "--out", "done")
    assert "name the column that numbers them in [read.episode]" in said
    (here / "map.toml").write_text((here / "map.toml").read_text() + '\n[read.episode]\ncolumn = "take"\n')
    assert main(["import", "log.npz", "--map", "map.toml", "--out", "done"]) == 0
    assert read(here / "done").n_episodes == 2


def test_a_log_that_is_given_for_a_dataset_is_to_be_imported(here, capsys):
    write_log(here / "log.npz", columns_of(motion()))
    assert "nas import log.npz --map MAP.toml" in refused(capsys, "gap", "find", "log.npz", "--model", "arm.xml")


def test_an_unpaired_dataset_is_paired_by_the_command_that_training_names(here, capsys):
    simulated(here / "d", (60, 60))
    said = refused(capsys, "train", "delta", "d")
    (command,) = commands_in(said)
    assert command == ["pair", "d", "--model", "MODEL.xml"]
    assert main([*command[:-1], "arm.xml"]) == 0


def test_an_unpaired_part_of_a_merge_is_paired_as_is_said(here, capsys):
    simulated(here / "a", (60,))
    simulated(here / "b", (50,))
    assert main(["pair", "a", "--model", "arm.xml", "--out", "pa"]) == 0
    assert "pair both with the same model (nas pair)" in refused(capsys, "merge", "pa", "b", "--out", "m")
    assert main(["pair", "b", "--model", "arm.xml", "--out", "pb"]) == 0
    assert main(["merge", "pa", "pb", "--out", "m"]) == 0


def test_a_half_written_dataset_is_rescued_by_the_command_that_is_named(here, capsys):
    root = write(recorded(lengths=(20, 20)), here / "d", Provenance(how="simulated", robot="ergojr"))
    path = layout.list_data_files(root)[0]
    path.write_bytes(path.read_bytes()[:-200])
    said = refused(capsys, "info", "d")
    assert "'nas recover'" in said
    assert main(["recover", "d"]) == 0


def test_a_dataset_changed_in_place_is_made_a_version_as_is_said(here, capsys):
    root = write(recorded(lengths=(20,)), here / "d", Provenance(how="simulated", robot="ergojr"))
    path = layout.list_data_files(root)[0]
    table = pq.read_table(path)
    index = table.schema.get_field_index("next.done")
    pq.write_table(table.set_column(index, "next.done", table["next.done"].combine_chunks().is_null()), path)
    assert "'nas merge'" in refused(capsys, "pack", "d", "--out", "p.nas.tar")
    assert main(["merge", "d", "--out", "m"]) == 0
    assert main(["pack", "m", "--out", "p.nas.tar"]) == 0


def test_lost_provenance_is_started_anew_by_the_commands_that_verify_names(here, capsys):
    root = simulated(here / "d", (60, 60))
    (root / layout.PROVENANCE).unlink()
    assert "(pair, merge, split) starts one" in refused(capsys, "verify", "d")
    for number, command in enumerate((["pair", "d", "--model", "arm.xml"], ["merge", "d"])):
        assert main([*command, "--out", f"n{number}"]) == 0 and main(["verify", f"n{number}"]) == 0


# What other programs mend


def command_of(said: str, program: str) -> list[str]:
    """The command of another program that a sentence names."""
    ((quoted, bracketed),) = re.findall(rf"'({program} [^']+)'|\(({program} [^)]+)\)", said)
    return shlex.split(quoted or bracketed)


def test_a_bag_whose_recorder_was_killed_is_read_once_it_has_its_metadata_again(here, capsys):
    """`ros2 bag reindex` writes the metadata from what the bag holds; here they are put back."""
    write_rosbag(here / "my bag")
    write_map(here, BAG_MAP.format(format="rosbag"))
    metadata = here / "my bag/metadata.yaml"
    metadata.rename(here / "kept.yaml")
    said = refused(capsys, "import", "my bag", "--map", "map.toml", "--out", "never")
    assert command_of(said, "ros2") == ["ros2", "bag", "reindex", "my bag"]
    (here / "kept.yaml").rename(metadata)
    assert main(["import", "my bag", "--map", "map.toml", "--out", "done"]) == 0


def test_a_ros_1_bag_is_mended_by_the_program_of_ros_1(here, capsys):
    write_map(here, BAG_MAP.format(format="rosbag"))
    (here / "log.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    said = refused(capsys, "import", "log.bag", "--map", "map.toml", "--out", "never")
    assert command_of(said, "rosbag") == ["rosbag", "reindex", "log.bag"]


def test_an_mcap_file_that_was_cut_off_is_read_once_its_messages_are_recovered(here, capsys):
    """`mcap recover` copies the messages that can be read into a new file; so does this test, by MCAP's own library."""
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader
    from mcap.writer import Writer

    write_json_mcap(here / "whole.mcap")
    (here / "my bag.mcap").write_bytes((here / "whole.mcap").read_bytes()[:-300])
    write_map(here, BAG_MAP.format(format="mcap"))
    said = refused(capsys, "import", "my bag.mcap", "--map", "map.toml", "--out", "never")
    program, deed, damaged, option, repaired = command_of(said, "mcap")
    assert (program, deed, damaged, option) == ("mcap", "recover", "my bag.mcap", "-o")
    with Path(damaged).open("rb") as source, Path(repaired).open("wb") as target:
        writer, kinds, topics = Writer(target), {}, {}
        writer.start()
        try:
            for record in StreamReader(source).records:
                if isinstance(record, Schema) and record.id not in kinds:
                    kinds[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                elif isinstance(record, Channel) and record.id not in topics:
                    kind = kinds[record.schema_id]
                    topics[record.id] = writer.register_channel(record.topic, record.message_encoding, kind)
                elif isinstance(record, Message):
                    times = {"log_time": record.log_time, "publish_time": record.publish_time}
                    writer.add_message(topics[record.channel_id], data=record.data, **times)
        except McapError:
            pass
        writer.finish()
    assert main(["import", repaired, "--map", "map.toml", "--out", "done"]) == 0


def as_v21(root: Path) -> None:
    """Turn a dataset into what LeRobot 0.3 wrote: a file an episode, tables in JSON lines."""
    (whole,) = layout.list_data_files(root)
    rows, info = pq.read_table(whole), json.loads((root / layout.INFO).read_text())
    episodes, statistics = [], []
    for number in sorted(set(rows["episode_index"].to_pylist())):
        part = rows.filter(pa.compute.equal(rows["episode_index"], number))
        pq.write_table(part, root / f"data/chunk-000/episode_{number:06d}.parquet")
        episodes.append({"episode_index": number, "tasks": ["swing"], "length": len(part)})
        values = {key: np.array(part[key].to_pylist(), float).reshape(len(part), -1) for key in part.column_names}
        found = {key: {name: getattr(value, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
                 for key, value in values.items()}  # fmt: skip
        counted = {key: {**value, "count": [len(part)]} for key, value in found.items()}
        statistics.append({"episode_index": number, "stats": counted})
    for path in (whole, root / layout.TASKS, root / layout.STATS, root / layout.PROVENANCE):
        path.unlink()
    shutil.rmtree(root / "meta/episodes")
    tables = {"episodes": episodes, "episodes_stats": statistics, "tasks": [{"task_index": 0, "task": "swing"}]}
    for name, entries in tables.items():
        (root / f"meta/{name}.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    info |= {"codebase_version": "v2.1", "data_path": path, "total_chunks": 1, "total_videos": 0}
    (root / layout.INFO).write_text(json.dumps(info))


def test_the_converter_that_is_named_is_the_installed_lerobots(here, capsys):
    lerobot = pytest.importorskip("lerobot")
    (simulated(here / "old") / layout.INFO).write_text(json.dumps({"codebase_version": "v2.1"}))
    _, _, module, *options = command_of(refused(capsys, "info", "old"), "python")
    script = Path(lerobot.__file__).parent.joinpath(*module.split(".")[1:]).with_suffix(".py").read_text()
    assert all(f'"{option.partition("=")[0]}"' in script for option in options) and len(options) == 3


@pytest.mark.slow
def test_a_dataset_of_lerobot_0_3_is_converted_by_the_command_that_is_named(here, capsys):
    pytest.importorskip("lerobot")
    pytest.importorskip("jsonlines")
    as_v21(simulated(here / "old", (30, 20)))
    said = refused(capsys, "info", "old")
    _, *command = command_of(said, "python")
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, env=OFFLINE, check=False)
    assert done.returncode == 0, done.stderr
    assert read(here / "old").lengths.tolist() == [30, 20]
    assert (here / "old_old").is_dir()
