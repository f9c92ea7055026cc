"""What a finding of an audit names as its remedy ends the finding."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import ARM

import nas_data as nas
from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, TIME, make_position_feature, make_state_feature, make_time_feature
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.dataset.write import write

Columns = Mapping[str, np.ndarray]
Logs = Sequence[Columns]
SOUND = columns_of(motion())
LONG = columns_of(motion(rows=400))
RAD = 'column = "{}"\nunit = "rad{}"'


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def edited(columns: Columns = SOUND, **edits: Callable[[np.ndarray], np.ndarray]) -> Columns:
    return {key: edits[key](column) if key in edits else column for key, column in columns.items()}


def rows(columns: Columns, chosen: object) -> Columns:
    return {key: column[chosen] for key, column in columns.items()}


def at(row: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that replaces a row."""

    def change(values: np.ndarray) -> np.ndarray:
        return np.where((np.arange(len(values)) == row).reshape(-1, *[1] * (values.ndim - 1)), value, values)

    return change


def shifted(row: int, seconds: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that moves the times from a row on."""
    return lambda time: time + seconds * (np.arange(len(time)) >= row)


def swapped(values: np.ndarray) -> np.ndarray:
    return values[:, ::-1]


def wrapped(values: np.ndarray) -> np.ndarray:
    return np.where(values > 0.4, values - 2 * np.pi, values)


def late(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[:1], values[:1], values[:-2]])


def held(values: np.ndarray) -> np.ndarray:
    """Repeat every reading once."""
    return values[np.arange(400) // 2 * 2]


def stuck(values: np.ndarray) -> np.ndarray:
    """Keep the second joint's value from row 100 on for 2 s."""
    return np.column_stack([values[:, 0], np.where(abs(np.arange(400) - 150) < 50, values[100, 1], values[:, 1])])


def derived(**changes: str) -> str:
    text = map_text(velocity='"derive"', **changes)
    return text.replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"\n', "")


def limits(high: float, **changes: str) -> str:
    return map_text(extra=f"[limits]\nshoulder = [-1.5, {high}]", **changes)


def picked(key: str, column: str, unit: str = "rad", order: str = "[1, 0]") -> str:
    return map_text(**{key: f'column = "{column}"\ncomponents = {order}\nunit = "{unit}"'})


TWICE = rows(SOUND, np.repeat(np.arange(120), 1 + (np.arange(120) == 30)))
GAP = edited(t=shifted(40, 0.03))
PARTS = [rows(GAP, slice(40)), rows(GAP, slice(40, None))]
TAKES = rows(SOUND, np.tile(np.arange(60), 2))
DEGREES = {key: f'column = "{column}"\nunit = "{unit}"' for key, column, unit in
           (("position", "q", "deg"), ("register", "dq", "deg/s"), ("command", "goal", "deg"))}  # fmt: skip
RESAMPLED = '[resample]\nrate = 50.0\nmethod = "linear"'
TORQUE = '[signals.torque_enable]\ncolumn = "on"\nunit = "1"'
ON = np.column_stack([np.ones(400), abs(np.arange(400) - 150) >= 50])
FROZEN = edited(LONG, q=stuck)
SCALED = RAD.format("dq", "/s") + f"\nscale = {1 / 1.3}"
STALE = edited(LONG, q=held, dq=held)
SMALL = columns_of(motion(amplitude=0.08))
SMALL_DEGREES = edited(SMALL, q=np.degrees, dq=np.degrees, goal=np.degrees)
OF_EACH = '[read.{0}.joints.{1}]\nunit = "deg{2}"'
IN_DEGREES = {"q": "position", "dq": "velocity", "goal": "command"}
SPEEDS = {"command": 'column = "goal"\nunit = "rad/s"'}
ASKED = edited(LONG, goal=lambda values: LONG["dq"])


@dataclass(frozen=True)
class Fault:
    """A log and a map with a finding, its remedy in words, and pairs of logs and a map that follow it."""

    check: str
    said: str
    logs: Logs
    map: str
    mended: Sequence[tuple[Logs, str]]


FAULTS = {
    "a row without a number": Fault(
        "", "remove these rows, or split the log there", [edited(q=at(60, np.nan))], map_text(),
        [([rows(SOUND, np.arange(120) != 60)], map_text()),
         ([rows(SOUND, slice(60)), rows(SOUND, slice(61, None))], map_text())],
    ),
    "takes": Fault(
        "", "or give each take a file of its own", [TAKES], map_text(),
        [([rows(TAKES, slice(60)), rows(TAKES, slice(60, None))], map_text())],
    ),
    "no time": Fault(
        "", "name the time column in [read.time], or set uniform = true there if the log has none",
        [edited(t=np.zeros_like) | {"clock": SOUND["t"]}], map_text(),
        [([SOUND | {"clock": SOUND["t"]}], map_text(time='column = "clock"\nunit = "s"')),
         ([edited(t=np.zeros_like)], map_text(time="uniform = true"))],
    ),
    "a row twice": Fault(
        "repeated_time", "remove the rows that were written twice; if the clock is too coarse, set uniform = true",
        [TWICE], map_text(), [([SOUND], map_text()), ([TWICE], map_text(time="uniform = true"))],
    ),
    "a row twice, resampled": Fault(
        "repeated_time", "resampling takes the last of them; remove the rows that were written twice",
        [TWICE], map_text(extra=RESAMPLED), [([SOUND], map_text(extra=RESAMPLED))],
    ),
    "a gap that is filled": Fault(
        "time_gap", "that were not measured; to avoid this, split the log there", [GAP], map_text(extra=RESAMPLED),
        [(PARTS, map_text(extra=RESAMPLED))],
    ),
    "milliseconds": Fault(
        "", "correct 'rate' or the unit of [read.time]", [edited(t=lambda time: 1000 * time)], map_text(),
        [([edited(t=lambda time: 1000 * time)], map_text(time='column = "t"\nunit = "ms"'))],
    ),
    "a rate that is a little off": Fault(
        "rate", "correct 'rate' or the unit of [read.time], or add [resample].",
        [SOUND], map_text(rate="49.0"), [([SOUND], map_text()), ([SOUND], map_text(rate="49.0", extra=RESAMPLED))],
    ),
    "an uneven step": Fault(
        "irregular_time", "add [resample] to the map", [edited(t=shifted(40, 0.01))], map_text(),
        [([edited(t=shifted(40, 0.01))], map_text(extra=RESAMPLED))],
    ),
    "uneven steps and derived velocities": Fault(
        "irregular_time", "to space rows evenly, because velocities are derived as if they were",
        [edited(t=shifted(40, 0.01))], derived(), [([edited(t=shifted(40, 0.01))], derived(extra=RESAMPLED))],
    ),
    "a wrap": Fault("jump", "import with --unwrap", [edited(q=wrapped)], map_text(), []),
    "a fast joint": Fault(
        "jump", "set a larger max_speed in [audit]; if readings are wrong, remove the rows", [SOUND],
        map_text(extra="[audit]\nmax_speed = 3.5"), [([SOUND], map_text(extra="[audit]\nmax_speed = 5.0"))],
    ),
    "a wrong reading": Fault(
        "jump", "if readings are wrong, remove the rows", [edited(q=at(50, 2.0))], map_text(),
        [([rows(SOUND, np.arange(120) != 50)], map_text())],
    ),
    "limits": Fault(
        "position_beyond_limits", "correct the joint's [limits], or its unit, sign or zero in [read.position]",
        [SOUND], limits(0.4),
        [([SOUND], limits(0.6)),
         ([SOUND], limits(0.4, position=RAD.format("q", "") + "\nzero = 0.2"))],
    ),
    "limits of commands": Fault(
        "command_beyond_limits", "correct the joint's [limits], or its unit, sign or zero in [read.command]",
        [edited(q=lambda values: 0.7 * values, dq=lambda values: 0.7 * values)], limits(0.4), [([SOUND], limits(0.6))],
    ),
    "degrees beyond limits": Fault(
        "", "if the log is in degrees or ticks, correct the unit in [read.position]",
        [SMALL_DEGREES], limits(1.5), [([SMALL_DEGREES], limits(1.5, **DEGREES))],
    ),
    "one joint in degrees": Fault(
        "", "or in [read.position.joints.elbow] where the map has it",
        [edited(**dict.fromkeys(IN_DEGREES, lambda values: values * [1, 180 / np.pi]))],
        map_text(extra='[read.position.joints.elbow]\nunit = "rad"'),
        [([edited(**dict.fromkeys(IN_DEGREES, lambda values: values * [1, 180 / np.pi]))],
          map_text(extra="\n".join(OF_EACH.format(name, "elbow", "/s" * (name == "velocity"))
                                   for name in IN_DEGREES.values())))],
    ),
    "commands in radians": Fault(
        "", "correct the unit in [read.command] or [read.position]", [SOUND],
        map_text(command='column = "goal"\nunit = "deg"', extra='[audit]\nallow = ["unit_slip"]'),
        [([SOUND], map_text())],
    ),
    "positions in degrees": Fault(
        "", "or [read.position]", [edited(SMALL, q=np.degrees)], derived(),
        [([edited(SMALL, q=np.degrees)], derived(position='column = "q"\nunit = "deg"'))],
    ),
    "commanded turns a minute": Fault(
        "command_scale", "the factor between turns a minute and rad/s; correct the unit in [read.command]",
        [edited(ASKED, goal=lambda values: values * 9.5493 * 1.01)], map_text(**SPEEDS),
        [([edited(ASKED, goal=lambda values: values * 9.5493 * 1.01)],
          map_text(command='column = "goal"\nunit = "rpm"'))],
    ),
    "commands of the other sign": Fault(
        "command_sign", "check 'sign' in [read.command] and [read.position]", [edited(goal=np.negative)], map_text(),
        [([edited(goal=np.negative)], map_text(command=RAD.format("goal", "") + "\nsign = -1"))],
    ),
    "positions for commands": Fault(
        "command_is_position", "check that [read.command] names the commands", [SOUND],
        map_text(command=RAD.format("q", "")), [([SOUND], map_text())],
    ),
    "joints in another order": Fault(
        "joints_swapped", "check the order of the columns in [read.position] and [read.command]",
        [edited(LONG, goal=swapped)], map_text(), [([edited(LONG, goal=swapped)], picked("command", "goal"))],
    ),
    "velocities of other joints": Fault(
        "position_contradicts_velocity", "check 'columns' in [read.position] and [read.velocity]",
        [edited(LONG, dq=swapped)], map_text(), [([edited(LONG, dq=swapped)], picked("register", "dq", "rad/s"))],
    ),
    "a servo without torque": Fault(
        "frozen_reading", "if its torque is off, name the column that shows this in [signals.torque_enable]; else "
        "remove the rows", [FROZEN | {"on": ON}], derived(),
        [([FROZEN | {"on": ON}], derived(extra=TORQUE)),
         ([rows(FROZEN, slice(101)), rows(FROZEN, slice(200, None))], derived())],
    ),
    "readings more often than the robot has them": Fault(
        "repeated_samples", "to avoid this, record at the rate of the robot's readings or more slowly",
        [STALE], map_text(), [([rows(LONG, slice(None, None, 2))], map_text(rate="25.0"))],
    ),
    "a register of an odd scale": Fault(
        "velocity_scale", "correct the unit or 'scale' in [read.velocity]", [edited(dq=lambda values: 1.3 * values)],
        map_text(),
        [([edited(dq=lambda values: 1.3 * values)], map_text(register=SCALED))],
    ),
    "a late register": Fault(
        "velocity_lag", "velocity = 'derive' in the map takes it from the positions", [edited(LONG, dq=late)],
        map_text(), [([edited(LONG, dq=late)], derived())],
    ),
}  # fmt: skip


def import_logs(folder: Path, logs: Logs, text: str, out: str, *options: str) -> int:
    for path in folder.glob("*.npz"):
        path.unlink()
    names = [write_log(folder / f"log{number}.npz", dict(log)).name for number, log in enumerate(logs)]
    write_map(folder, text)
    return main(["import", *names, "--map", "map.toml", "--out", out, *options])


@pytest.mark.parametrize("name", FAULTS)
def test_a_finding_in_a_log_ends_with_its_remedy(here, capsys, name):
    fault = FAULTS[name]
    code = import_logs(here, fault.logs, fault.map, "faulty")
    said = capsys.readouterr()
    assert code == (0 if fault.check else 2) and fault.said in said.out + said.err, said
    assert not fault.check or f"Warning {fault.check}:" in said.out, said
    for number, (logs, text) in enumerate(fault.mended):
        assert import_logs(here, logs, text, f"mended{number}") == 0, capsys.readouterr().err
        assert fault.check not in re.findall(r"Warning (\w+):", capsys.readouterr().out)


def test_an_encoders_wrap_ends_with_the_option_that_is_named(here, capsys):
    assert import_logs(here, [edited(q=wrapped)], map_text(), "done", "--unwrap") == 0
    assert "Warning" not in capsys.readouterr().out


# Datasets that were imported: what nas verify and nas gap find say


IN_USE = {
    "a rate that is a little off": "rate",
    "an uneven step": "irregular_time",
    "a row twice": "repeated_time",
    "a wrong reading": "jump",
    "commands of the other sign": "command_sign",
    "joints in another order": "joints_swapped",
    "positions for commands": "command_is_position",
    "a register of an odd scale": "velocity_scale",
    "velocities of other joints": "position_contradicts_velocity",
    "a servo without torque": "frozen_reading",
}
IN_GAP = ("a wrong reading", "commands of the other sign", "joints in another order", "a servo without torque")


def verify(capsys, root: str) -> str:
    capsys.readouterr()
    main(["verify", root])
    return capsys.readouterr().out


@pytest.mark.parametrize("name", IN_USE)
def test_verify_names_the_remedy_for_an_import_which_ends_its_finding(here, capsys, name):
    fault = FAULTS[name]
    (logs, text), *_ = fault.mended
    assert import_logs(here, fault.logs, fault.map, "faulty") == import_logs(here, logs, text, "mended") == 0
    said = verify(capsys, "faulty")
    remedy = "if readings are wrong, remove the rows" if name == "a wrong reading" else fault.said.rstrip(".")
    (line,) = [line for line in said.splitlines() if remedy in line][:1]
    assert "import it with a corrected map: " in line or name == "a wrong reading", line
    assert remedy not in verify(capsys, "mended")


@pytest.mark.parametrize("name", IN_GAP)
def test_the_gap_names_the_remedy_for_an_import(here, capsys, name):
    Path("arm.xml").write_text(ARM)
    fault = FAULTS[name]
    (logs, text), *_ = fault.mended
    for part, writings, mapping in (("faulty", fault.logs, fault.map), ("mended", logs, text)):
        mapping = mapping.replace('["shoulder", "elbow"]', '["j1", "j2"]')
        seconds = "1" if len(fault.logs[0]["t"]) == 120 else "3.9"
        assert import_logs(here, writings, mapping, part, "--cut", seconds) == 0
        capsys.readouterr()
        assert main(["gap", "find", part, "--model", "arm.xml"]) == 0
        said = " ".join(capsys.readouterr().out.split())
        remedy = "if readings are wrong, remove the rows" if name == "a wrong reading" else fault.said
        assert (remedy in said) is (part == "faulty"), said


def test_an_episode_with_wrong_readings_is_split_off_as_is_said(here, capsys):
    logs = FAULTS["a wrong reading"].logs
    assert import_logs(here, [SOUND, *logs], map_text(), "both") == 0
    assert "remove the rows, or the episode (nas split --episodes)" in verify(capsys, "both")
    assert main(["split", "both", "--episodes", "0", "--names", "kept", "rest"]) == 0
    assert "remove the rows" not in verify(capsys, "datasets/kept")


def test_a_finding_that_was_allowed_is_allowed_in_all_that_is_made_from_the_import(here, capsys):
    fast = edited(t=lambda time: time / 1.1)
    assert import_logs(here, [fast, fast], map_text(extra='[audit]\nallow = ["rate"]'), "both") == 0
    assert main(["split", "both", "--episodes", "0", "--names", "one", "other"]) == 0
    assert main(["merge", "datasets/one", "datasets/other", "--out", "merged"]) == 0
    loaded = nas.Dataset.load("merged")
    changed = loaded.with_column(ACTION, loaded.features[ACTION], loaded.commands * np.float32(0.9)).save("edited")
    for root in ("both", "datasets/one", "merged", str(changed)):
        assert nas.Dataset.load(root).n_episodes == (1 if "one" in root else 2)
        said = verify(capsys, root)
        assert "come at 55 Hz" in said and "problem" not in said.splitlines()[0], said


def test_recordings_with_a_stall_are_usable_once_merged_and_those_of_other_tools_are_not(here):
    for root in ("ours", "theirs"):
        foreign(edited(t=shifted(40, 0.5)), root)
    write(read(Path("ours")), Path("recorded"), Provenance(how="hardware", robot="arm2", contiguous=True))
    assert main(["merge", "recorded", "recorded", "--out", "merged"]) == 0
    assert nas.Dataset.load("merged").n_episodes == 4
    assert main(["merge", "theirs", "theirs", "--out", "unknown"]) == 0
    with pytest.raises(nas.NasError, match="nas import unknown divides the episodes there"):
        nas.Dataset.load("unknown")


# Datasets of other tools: the warnings of every command, and nas verify


def foreign(columns: Columns, root: str = "d") -> None:
    """Write columns as a dataset of two episodes that another tool wrote: no provenance."""
    features = {
        STATE: make_state_feature(("j1", "j2")),
        ACTION: make_position_feature(("j1", "j2")),
        TIME: make_time_feature(),
    }
    values = {STATE: np.hstack([columns["q"], columns["dq"]]), ACTION: columns["goal"], TIME: columns["t"][:, None]}
    twice = {key: np.tile(column, (2, 1)).astype(features[key].dtype) for key, column in values.items()}
    dataset = Dataset(features, twice, np.full(2, len(columns["t"])), 50.0, "arm2")
    write(dataset, Path(root), Provenance(how="simulated", robot="arm2", contiguous=True))
    Path(root, layout.PROVENANCE).unlink()


OWN = """format = "lerobot"
robot = "arm2"
joints = ["j1", "j2"]
alignment = "action_follows_state"
velocity = "{}"
[read.position]
unit = "rad"
[read.command]
unit = "rad"
{}
"""
FOREIGN = {
    "a rate that is a little off": (
        edited(t=lambda time: time * 1.01), ["import d --rate 49.505", "import d --uniform"], "", "rows come at"),
    "uneven steps": (edited(t=lambda time: time + 0.007 * (np.arange(120) % 3)), ["import d --uniform"], "",
                     "if only the time stamps are uneven"),
    "a wrap": (edited(q=wrapped), ["import d --unwrap"], "", "come from an encoder that wraps around"),
    "a wrong reading": (edited(q=at(50, 2.0)), [], "", "remove the rows, or the episode (nas split --episodes)"),
    "commands of the other sign": (edited(goal=np.negative), ["import d --map MAP.toml"],
                                   OWN.format("derive", "sign = -1"), "check 'sign' in [read.command]"),
    "a late register": (edited(LONG, dq=late), ["import d --map MAP.toml"], OWN.format("derive", ""),
                        "velocity = 'derive'"),
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_a_warning_about_a_dataset_of_another_tool_ends_with_the_command_that_it_names(here, capsys, name):
    columns, commands, own, part = FOREIGN[name]
    foreign(columns)
    assert main(["info", "d"]) == 0
    for said in (capsys.readouterr().out, verify(capsys, "d")):
        assert part in said, said
        found = re.findall(r"nas (import [^);]+?)(?:[);]|\.\n|\n| \(and)", said)
        assert list(dict.fromkeys(found)) == commands, said
    Path("MAP.toml").write_text(own)
    for number, command in enumerate(commands):
        assert main([*command.split(), "--out", f"done{number}"]) == 0
        assert part not in verify(capsys, f"done{number}")


def test_an_import_without_a_map_says_where_a_remedy_belongs(here, capsys):
    foreign(edited(goal=np.negative))
    assert main(["import", "d", "--out", "faulty"]) == 0
    assert "in a map of your own (--map): check 'sign' in [read.command]" in capsys.readouterr().out
    Path("own.toml").write_text(OWN.format("derive", "sign = -1"))
    assert main(["import", "d", "--map", "own.toml", "--out", "mended"]) == 0
    assert "Warning" not in capsys.readouterr().out


# Arrays in Python


def arrays(columns: Columns, **changes: object) -> dict[str, object]:
    made = {"positions": columns["q"], "velocities": columns["dq"], "commands": columns["goal"], "times": columns["t"]}
    made |= {"rate": 50, "joints": ["j1", "j2"]} | changes
    return {key: value for key, value in made.items() if value is not None}


HOLE = edited(t=shifted(60, 3.0))
IN_PYTHON = {
    "give positions and commands in one unit": (arrays(edited(goal=np.degrees)), arrays(SOUND)),
    "give the commands, not what was measured": (arrays(SOUND, commands=SOUND["q"]), arrays(SOUND)),
    "put the columns of both in the order of 'joints'": (arrays(edited(LONG, goal=swapped)), arrays(LONG)),
    "divide the arrays there: lists of arrays, one an episode": (
        arrays(HOLE),
        {key: np.split(value, [60]) if isinstance(value, np.ndarray) else value for key, value in arrays(HOLE).items()},
    ),
    "resample the rows, or leave 'times' out if the rows are evenly spaced": (
        arrays(edited(t=lambda time: time + 0.007 * (np.arange(120) % 3))), arrays(SOUND, times=None)),
    "correct 'velocities', or leave them out": (
        arrays(edited(dq=np.negative)), arrays(SOUND), arrays(SOUND, velocities=None)),
    "leave 'velocities' out, so that they are derived": (
        arrays(edited(LONG, dq=late)), arrays(LONG, velocities=None)),
    "correct the arrays, or leave 'velocities' out": (arrays(edited(LONG, dq=swapped)), arrays(LONG, velocities=None)),
    "give numpy.unwrap(positions, axis=0)": (
        arrays(edited(q=wrapped)), arrays(edited(q=lambda values: np.unwrap(wrapped(values), axis=0)))),
}  # fmt: skip


@pytest.mark.parametrize("said", IN_PYTHON)
def test_arrays_are_changed_as_the_audits_say(capsys, said):
    wrong, *mends = IN_PYTHON[said]
    try:
        nas.Dataset.from_arrays(**wrong)
    except nas.NasError as error:
        assert said in str(error)
    else:
        assert said in capsys.readouterr().err
    for mended in mends:
        nas.Dataset.from_arrays(**mended)
        assert "warning" not in capsys.readouterr().err
