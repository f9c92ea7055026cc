"""Maps: shipped ones load, and whatever is wrong with one is said in a sentence that names the key."""

import re
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.import_samples import columns_of, map_text, motion, sample_map, write_log, write_map

from nas_data.errors import LogError, MapError, UnknownName
from nas_data.importing.map_file import MAPS, load_map
from nas_data.pairing import pair
from nas_data.recorders.logs import import_logs
from nas_data.simulators.mujoco import MujocoSimulator

SHIPPED = sorted(path.stem for path in MAPS.glob("*.toml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_map_loads_by_its_name_and_by_its_path(name):
    assert load_map(name) == load_map(MAPS / f"{name}.toml")


def test_the_maps_of_the_contract_are_shipped():
    assert {"so101_npz", "so101_csv", "xl330_json"} <= set(SHIPPED)


def test_both_so101_maps_mean_the_same_robot():
    one, other = load_map("so101_npz"), load_map("so101_csv")
    for name in ("robot", "joints", "rate", "alignment", "derive_velocity", "limits", "thresholds"):
        assert getattr(one, name) == getattr(other, name)
    for name in ("position", "velocity", "command"):
        assert getattr(one, name).conversion == getattr(other, name).conversion


def test_an_unknown_map_lists_the_shipped_ones():
    with pytest.raises(UnknownName, match=r"no map 'so99'.*so101_npz"):
        load_map("so99")


def test_a_missing_file_lists_the_shipped_ones(tmp_path):
    with pytest.raises(MapError, match=r"There is no map .*my.toml; give a TOML file or one of: .*so101_npz"):
        load_map(tmp_path / "my.toml")


def test_a_file_that_is_no_toml_is_refused(tmp_path):
    with pytest.raises(MapError, match=r"map.toml is not valid TOML"):
        load_map(write_map(tmp_path, "format = csv"))
    (tmp_path / "map.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MapError, match="cannot be read as a map"):
        load_map(tmp_path / "map.toml")
    with pytest.raises(MapError, match="cannot be read as a map"):
        load_map(tmp_path)


def test_a_file_of_windows_notepad_is_read(tmp_path):
    plain = load_map(write_map(tmp_path))
    (tmp_path / "map.toml").write_text((tmp_path / "map.toml").read_text(), encoding="utf-8-sig")
    assert load_map(tmp_path / "map.toml") == plain


POSITION = 'column = "q"\n'
ELBOW = f'{POSITION}unit = "rad"\n[read.position.joints.elbow]\n'
WRONG = {
    "unknown key": (
        map_text() + "[audit]\nspeed = 3",
        r"\[audit\]: there is no key 'speed' here .*'max_speed'\?\); the keys are: allow",
    ),
    "unknown top key": ("jonits = []\n" + map_text(), "there is no key 'jonits' here"),
    "unknown quantity": (map_text(extra="[read.torque]\ncolumn='x'"), r"\[read\]: there is no key 'torque'"),
    "key of another format": (map_text(top='entries = "rows"'), "no key 'entries' here: it belongs to format = 'json'"),
    "join of one file": (map_text(top='[join]\nmethod = "nearest"'), r"no key 'join' here: it belongs to .*\[files\]"),
    "misspelt optional key": (
        map_text(extra="[resampel]\nrate = 50"),
        r"no key 'resampel' here \(did you mean 'resample'\?\); the keys are: .*delimiter, entries, .*join, .*resample",
    ),
    "misspelt needed key": (
        map_text().replace("rate =", "rates ="),
        "'rate' is missing \\(is 'rates' a misspelling of it",
    ),
    "column twice": (map_text(position='columns = ["q1", "q1"]\nunit = "rad"'), r"\[read.position\]: .*'q1' twice"),
    "command twice": (map_text(command='columns = ["c", "c"]\nunit = "rad"'), r"\[read.command\]: .*'c' twice"),
    "component twice": (map_text(position='column = "q"\ncomponents = [1, 1]\nunit = "rad"'), "names 1 twice"),
    "missing key": (map_text().replace('robot = "sample"', ""), "the key 'robot' is missing"),
    "missing table": (map_text().replace("[read.command]", "[read.commands]"), r"\[read.command\]: exactly one of"),
    "format": (
        map_text(format='"xlsx"'),
        "'format' is 'xlsx'; choose one of: csv, json, lerobot, mat, mcap, npz, parquet, pt, rosbag",
    ),
    "no joints": (map_text(joints="[]"), "'joints' is .*name each joint once"),
    "joint twice": (map_text(joints='["a", "a"]'), "name each joint once"),
    "joints no list": (map_text(joints='"a"'), "'joints' is 'a'; it must be a list of texts"),
    "rate zero": (map_text(rate="0"), "'rate' is 0; it must be above 0"),
    "rate text": (map_text(rate='"50"'), "'rate' is '50'; it must be a number"),
    "rate infinite": (map_text(rate="inf"), "'rate' is inf; it must be a number"),
    "robot number": (map_text().replace('"sample"', "3"), "'robot' is 3; it must be a text"),
    "alignment": (map_text(alignment='"same"'), "'alignment' is 'same'; choose one of: action_follows_state"),
    "velocity": (map_text(velocity='"guess"'), "'velocity' is 'guess'; choose one of: measured, derive"),
    "no register": (
        map_text().replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"', ""),
        r"'velocity' is 'measured' but there is no \[read.velocity\]",
    ),
    "time unit": (map_text(time='column = "t"\nunit = "min"'), "'unit' is 'min'; choose one of: s, ms, us, ns"),
    "clock or none": (
        map_text(time='column = "t"\nuniform = true'),
        r"\[read.time\]: .*leave out either it, or 'column' and 'unit'",
    ),
    "position unit": (
        map_text(position='column = "q"\nunit = "inch"'),
        "choose one of: rad, deg, turn, m, cm, mm, tic",
    ),
    "command unit": (map_text(command='column = "goal"\nunit = "lbf"'), "m, cm, mm, ticks, rad/s, .* N·m, .* N, A"),
    "slide in rad/s": (map_text(position='column = "q"\nunit = "mm"'), "choose one of: m/s, cm/s, mm/s, ticks"),
    "unknown slide": (map_text(top='slides = ["grip"]'), "'slides' names 'grip'; the joints are: shoulder, elbow"),
    "slide in rad": (map_text(top='slides = ["elbow"]'), "'elbow' is a slide, .* is 'rad'; choose one of: m, cm, mm"),
    "amperes without scale": (map_text(command='column = "goal"\nunit = "A"'), "the key 'scale' is missing"),
    "unit missing": (map_text(position='column = "q"'), "the key 'unit' is missing"),
    "sign": (map_text(position='column = "q"\nunit = "rad"\nsign = 2'), "'sign' is 2; it must be 1 or -1"),
    "list too short": (
        map_text(position='column = "q"\nunit = "rad"\noffset = [0.1]'),
        "'offset' has 1 number; 2 are needed",
    ),
    "list of texts": (
        map_text(position='column = "q"\nunit = "rad"\noffset = ["0.1", "0.2"]'),
        "'offset' is .*a number or a list of numbers",
    ),
    "ticks without scale": (
        map_text(position='column = "q"\nunit = "ticks"\nzero = 512'),
        "the key 'scale' is missing",
    ),
    "ticks without zero": (map_text(position='column = "q"\nunit = "ticks"\nscale = 0.1'), "the key 'zero' is missing"),
    "scale zero": (map_text(position='column = "q"\nunit = "rad"\nscale = 0'), "'scale' is 0"),
    "normalised without range": (map_text(position='column = "q"\nunit = "normalised"'), "the key 'range' is missing"),
    "normalised to a point": (
        map_text(position='column = "q"\nunit = "normalised"\nrange = [0, 1]\nlow = 1\nhigh = 1'),
        "ends must differ",
    ),
    "key of another unit": (
        map_text(position='column = "q"\nunit = "rad"\nlow = 0'),
        r"\[read.position\]: there is no key 'low'",
    ),
    "offset of a velocity": (map_text(register='column = "dq"\nunit = "rad/s"\noffset = 1'), "no key 'offset'"),
    "unit of all joints": (map_text(position=POSITION + 'unit = "inch"'), r"\[read.position\]: 'unit' is 'inch'"),
    "unit of one joint": (map_text(position=ELBOW + 'unit = "inch"'), r"\[read.position.joints.elbow\]: 'unit' is"),
    "units in a list": (
        map_text(position=POSITION + 'unit = ["rad", "deg"]'),
        r"\[read.position\]: 'unit' is a list, .* in \[read.position.joints.JOINT\]",
    ),
    "a sign of a list": (
        map_text(position=POSITION + 'unit = "rad"\nsign = [1, 3]'),
        r"\[read.position\]: 'sign' is 3",
    ),
    "a sign of one joint": (map_text(position=ELBOW + "sign = 3"), r"\[read.position.joints.elbow\]: 'sign' is 3"),
    "scale for one joint": (
        map_text(position=ELBOW + 'unit = "ticks"\nzero = 3'),
        r"\[read.position.joints.elbow\]: the key 'scale' is missing",
    ),
    "scale for all joints": (
        map_text(position='column = "q"\nunit = "ticks"\nzero = 3\n[read.position.joints.elbow]\nsign = -1'),
        r"\[read.position\]: the key 'scale' is missing",
    ),
    "key of one joint": (
        map_text(position=ELBOW + "skale = 3"),
        r"\[read.position.joints.elbow\]: there is no key 'skale'",
    ),
    "one slide in rad": (
        map_text(top='slides = ["elbow"]', position=ELBOW + 'unit = "deg"'),
        r"its unit in \[read.position.joints.elbow\] is 'deg'",
    ),
    "unknown joint": (
        map_text(position='column = "q"\nunit = "rad"\n[read.position.joints.wrist]\nsign = -1'),
        "there is no key 'wrist' here; the keys are: elbow, shoulder",
    ),
    "two places": (map_text(position='column = "q"\ncolumns = ["a", "b"]\nunit = "rad"'), "exactly one of 'column' or"),
    "too few columns": (map_text(position='columns = ["a"]\nunit = "rad"'), "names 1 column; 2 are needed"),
    "components": (map_text(position='column = "q"\ncomponents = [0]\nunit = "rad"'), "'components' picks 2"),
    "negative component": (map_text(position='column = "q"\ncomponents = [0, -1]\nunit = "rad"'), "whole numbers"),
    "encoding": (map_text(position='column = "q"\nunit = "rad"\nencoding = "int12"'), "'encoding' is 'int12'"),
    "signal named image": (map_text(extra='[signals.image]\ncolumn = "x"\nunit = "1"'), "cannot name a signal"),
    "signal named time": (map_text(extra='[signals.time]\ncolumn = "x"\nunit = "1"'), "cannot name a signal"),
    "signal named velocity": (
        map_text(velocity='"derive"', extra='[signals.velocity]\ncolumn = "x"\nunit = "1"'),
        r"\[signals.velocity\]: 'velocity' cannot name a signal, because velocity = 'derive' keeps those of",
    ),
    "signals no table": (map_text(top="signals = 3"), r"'signals' is 3; it must be a table: \[signals\]"),
    "whole_robot": (map_text(extra='[signals.a]\ncolumn = "x"\nwhole_robot = 1\nunit = "1"'), "must be true or false"),
    "limits": (map_text(extra="[limits]\nelbow = [1, -1]"), "'elbow' is 1 … -1; the first must be below"),
    "limits of another joint": (map_text(extra="[limits]\nwrist = [-1, 1]"), "no joint 'wrist'; the joints are"),
    "allow": (map_text(extra='[audit]\nallow = ["not_finite"]'), "'allow' names 'not_finite'; only these"),
    "resample without method": (map_text(extra="[resample]\nrate = 10"), r"\[resample\]: the key 'method' is missing"),
    "task": (map_text(top='task = "{mass}"'), "braces may hold: log, not 'mass'"),
    "task braces": (map_text(top='task = "{log"'), "its braces do not match"),
    "task format": (map_text(top='task = "{log:d}"'), "braces may hold: log, not 'log:d'"),
    "join missing": (
        map_text(top='[files]\na = "a.npz"\nb = "b.npz"'),
        "the key 'method' is missing",
    ),
    "file missing": (
        map_text(top='[files]\na = "a.npz"\nb = "b.npz"\n[join]\nmethod = "nearest"\ntolerance = 1'),
        "the key 'file' is missing",
    ),
    "file unknown": (
        map_text(
            top='[files]\na = "a.npz"\nb = "b.npz"\n[join]\nmethod = "nearest"\ntolerance = 1',
            position='file = "c"\ncolumn = "q"\nunit = "rad"',
        ),
        "'file' is 'c'; choose one of: a, b",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_map_is_refused_with_the_key_that_is_wrong(tmp_path, name):
    text, message = WRONG[name]
    tomllib.loads(text)
    with pytest.raises(MapError, match=message) as raised:
        load_map(write_map(tmp_path, text))
    assert "map.toml" in str(raised.value)


FIRST = '"q1", "q2"'
TWO = '[files]\na = "a.npz"\nb = "b.npz"\n'
JOINED = f'{TWO}[join]\nmethod = "nearest"\ntolerance = 1'
IN_FILES = {key: f'file = "{file}"\ncolumn = "{column}"\nunit = "{unit}"' for key, file, column, unit in (
    ("position", "a", "q", "rad"), ("register", "a", "dq", "rad/s"), ("command", "b", "goal", "rad"))}  # fmt: skip
SLIDES = {"position": 'column = "q"\nunit = "mm"', "register": 'column = "dq"\nunit = "mm/s"',
          "command": 'column = "goal"\nunit = "mm"'}  # fmt: skip
IN_TICKS = 'column = "q"\nunit = "ticks"\nscale = 0.1\nzero = 512'
BY_RANGE = 'column = "q"\nunit = "normalised"\nrange = [0, 1]\nlow = -1\nhigh = 1'
ELBOW_SLIDES = {
    "position": ELBOW + 'unit = "mm"',
    "register": 'column = "dq"\nunit = "rad/s"\n[read.velocity.joints.elbow]\nunit = "mm/s"',
    "command": 'column = "goal"\nunit = "rad"\n[read.command.joints.elbow]\nunit = "mm"',
}
# The map of `WRONG` with the same name after the change that its sentence asks for.
RIGHT = {
    "unknown key": map_text() + "[audit]\nmax_speed = 3",
    "unknown top key": 'pattern = "*"\n' + map_text(),
    "key of another format": map_text(format='"json"', top='entries = "rows"'),
    "join of one file": map_text(top=JOINED, **IN_FILES),
    "misspelt optional key": map_text(extra='[resample]\nrate = 50\nmethod = "linear"'),
    "column twice": map_text(position=f'columns = [{FIRST}]\nunit = "rad"'),
    "command twice": map_text(command='columns = ["c", "d"]\nunit = "rad"'),
    "component twice": map_text(position='column = "q"\ncomponents = [1, 0]\nunit = "rad"'),
    "format": map_text(format='"pt"'),
    "no joints": map_text(joints='["a", "b"]'),
    "joint twice": map_text(joints='["a", "b"]'),
    "joints no list": map_text(joints='["a"]'),
    "rate zero": map_text(rate="0.5"),
    "rate text": map_text(rate="50"),
    "rate infinite": map_text(rate="1e4"),
    "alignment": map_text(alignment='"action_follows_state"'),
    "velocity": map_text(velocity='"derive"'),
    "no register": map_text(velocity='"derive"').replace('[read.velocity]\ncolumn = "dq"\nunit = "rad/s"', ""),
    "time unit": map_text(time='column = "t"\nunit = "ms"'),
    "clock or none": map_text(time="uniform = true"),
    "position unit": map_text(position='column = "q"\nunit = "turn"'),
    "command unit": map_text(command='column = "goal"\nunit = "N·m"'),
    "slide in rad/s": map_text(**SLIDES),
    "unknown slide": map_text(top='slides = ["elbow"]', **ELBOW_SLIDES),
    "slide in rad": map_text(top='slides = ["elbow"]', **ELBOW_SLIDES),
    "amperes without scale": map_text(command='column = "goal"\nunit = "A"\nscale = 0.5'),
    "unit missing": map_text(position='column = "q"\nunit = "deg"'),
    "sign": map_text(position='column = "q"\nunit = "rad"\nsign = -1'),
    "list too short": map_text(position='column = "q"\nunit = "rad"\noffset = [0.1, 0.2]'),
    "list of texts": map_text(position='column = "q"\nunit = "rad"\noffset = 0.1'),
    "ticks without scale": map_text(position=IN_TICKS),
    "ticks without zero": map_text(position=IN_TICKS),
    "scale zero": map_text(position='column = "q"\nunit = "rad"\nscale = 0.1'),
    "normalised without range": map_text(position=BY_RANGE),
    "normalised to a point": map_text(position=BY_RANGE),
    "unit of one joint": map_text(position=ELBOW + 'unit = "deg"'),
    "units in a list": map_text(position=ELBOW + 'unit = "deg"'),
    "a sign of a list": map_text(position=POSITION + 'unit = "rad"\nsign = [1, -1]'),
    "a sign of one joint": map_text(position=ELBOW + "sign = -1"),
    "scale for one joint": map_text(position=ELBOW + 'unit = "ticks"\nzero = 3\nscale = 0.1'),
    "scale for all joints": map_text(position=IN_TICKS + "\n[read.position.joints.elbow]\nsign = -1"),
    "key of one joint": map_text(position=ELBOW + "scale = 3"),
    "one slide in rad": map_text(top='slides = ["elbow"]', **ELBOW_SLIDES),
    "unknown joint": map_text(position=ELBOW + "sign = -1"),
    "two places": map_text(position=f'columns = [{FIRST}]\nunit = "rad"'),
    "too few columns": map_text(position=f'columns = [{FIRST}]\nunit = "rad"'),
    "components": map_text(position='column = "q"\ncomponents = [0, 1]\nunit = "rad"'),
    "negative component": map_text(position='column = "q"\ncomponents = [0, 3]\nunit = "rad"'),
    "encoding": map_text(position='column = "q"\nunit = "rad"\nencoding = "sign_magnitude_10"'),
    "signal named image": map_text(extra='[signals.load_2]\ncolumn = "x"\nunit = "1"'),
    "signal named time": map_text(extra='[signals.load]\ncolumn = "x"\nunit = "1"'),
    "signal named velocity": map_text(velocity='"derive"', extra='[signals.speed]\ncolumn = "x"\nunit = "1"'),
    "signals no table": map_text(extra='[signals]\nload = {column = "x", unit = "1"}'),
    "whole_robot": map_text(extra='[signals.a]\ncolumn = "x"\nwhole_robot = true\nunit = "1"'),
    "limits": map_text(extra="[limits]\nelbow = [-1, 1]"),
    "limits of another joint": map_text(extra="[limits]\nshoulder = [-1, 1]"),
    "allow": map_text(extra='[audit]\nallow = ["rate"]'),
    "resample without method": map_text(extra='[resample]\nrate = 10\nmethod = "previous"'),
    "task": map_text(top='task = "{log}"'),
    "task braces": map_text(top='task = "{log} 2"'),
    "task format": map_text(top='constants = ["mass"]\ntask = "{log} {mass}"'),
    "join missing": map_text(top=JOINED, **IN_FILES),
    "file missing": map_text(top=JOINED, **IN_FILES),
    "file unknown": map_text(top=JOINED, **IN_FILES),
}
# What these sentences ask for is to write the key or table of the sample map.
OF_SAMPLE = {
    "unknown quantity", "misspelt needed key", "missing key", "missing table", "robot number", "key of another unit",
    "offset of a velocity", "unit of all joints",
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_map_is_read_once_it_is_changed_as_is_said(tmp_path, name):
    assert (name in RIGHT) != (name in OF_SAMPLE)
    load_map(write_map(tmp_path, RIGHT.get(name, map_text())))


def elbow(**units: str) -> dict[str, str]:
    """Tables of a map in which the elbow has units of its own."""
    columns = {"position": ("q", "rad"), "register": ("dq", "rad/s"), "command": ("goal", "rad")}
    return {
        key: f'column = "{column}"\nunit = "{unit}"' + (f"\njoints.elbow = {{{units[key]}}}" if key in units else "")
        for key, (column, unit) in columns.items()
    }


TICKS = 'unit = "ticks", scale = 0.001, zero = 0'
METRES = {"position": 'unit = "mm"', "register": 'unit = "mm/s"', "command": 'unit = "mm"'}


@pytest.mark.parametrize(
    ("top", "tables", "said", "mended"),
    [
        ("", {"command": 'unit = "mm"'}, "a hinge, because its positions are in 'rad'", ("", METRES)),
        (
            "",
            METRES | {"position": TICKS},
            "a hinge, because its positions are in 'ticks' and 'slides' does not name it",
            ('slides = ["elbow"]', METRES | {"position": TICKS}),
        ),
        (
            "",
            {"position": 'unit = "mm"', "register": 'unit = "mm/s"'},
            "a slide, because its positions are in 'mm'",
            ("", {}),
        ),
        ('slides = ["elbow"]', {"position": 'unit = "mm"'}, "a slide, because its positions are in 'mm'", ("", {})),
        ('slides = ["elbow"]', {}, "a slide, because 'slides' names it", ("", {})),
        ('slides = ["elbow"]', {}, "a slide, because 'slides' names it", ('slides = ["elbow"]', METRES)),
    ],
)
def test_a_unit_of_the_wrong_kind_of_joint_is_refused_with_what_says_the_kind(tmp_path, top, tables, said, mended):
    with pytest.raises(MapError, match=re.escape(f"'elbow' is {said}, but its unit in [")) as raised:
        sample_map(tmp_path, top=top, **elbow(**tables))
    assert "'slides'" in str(raised.value) or "the unit of its positions" in str(raised.value)
    top, tables = mended
    mapping = sample_map(tmp_path, top=top, **elbow(**tables))
    assert mapping.slides == ({"elbow"} if tables else set())


def test_normalised_values_and_overrides_of_one_joint(tmp_path):
    mapping = sample_map(
        tmp_path,
        position='column = "q"\nunit = "deg"\nsign = [1, -1]\n'
        '[read.position.joints.elbow]\nunit = "normalised"\nrange = [-100, 100]\nlow = -0.5\nhigh = 1.5',
        register='column = "dq"\nunit = "deg/s"\n'
        '[read.velocity.joints.elbow]\nunit = "normalised"\nrange = [-100, 100]\nlow = -0.5\nhigh = 1.5',
    )
    raw = np.array([[180.0, 0.0], [90.0, 100.0]])
    # The sign is the joint's and survives the other unit: -(0.5 + raw/100).
    np.testing.assert_allclose(mapping.position.conversion.apply(raw), [[np.pi, -0.5], [np.pi / 2, -1.5]])
    assert mapping.velocity is not None
    np.testing.assert_allclose(mapping.velocity.conversion.apply(raw)[:, 1], [0.0, 1.0])
    np.testing.assert_allclose(mapping.position.conversion.raw(mapping.position.conversion.apply(raw)), raw)


def test_torque_commands_become_efforts(tmp_path):
    truth = motion()
    columns = {"t": truth.time, "q": truth.position, "dq": truth.velocity, "goal": 40 * truth.command}
    log = write_log(tmp_path / "log.npz", columns)
    mapping = sample_map(tmp_path, command='column = "goal"\nunit = "N·m"\nscale = 0.1')
    dataset = import_logs([log], mapping).dataset
    assert set(dataset.kinds) == {".effort"}
    assert dataset.features["action"].names == ("shoulder.effort", "elbow.effort")
    np.testing.assert_allclose(dataset.commands, 4 * truth.command[:-1], rtol=1e-5, atol=1e-6)


DEGREE = np.pi / 180  # [rad]
VELOCITY_ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body pos="0 0 0.5"><joint name="shoulder" axis="0 0 1" damping="0.05" armature="0.02"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/>
<body pos="0.15 0 0"><joint name="elbow" axis="0 0 1" damping="0.05" armature="0.02"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03" contype="0" conaffinity="0"/>
</body></body></worldbody><actuator><velocity name="s" joint="shoulder" kv="2"/>{elbow}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("elbow", "command", "second"),
    [
        ('<velocity name="e" joint="elbow" kv="2"/>', 'unit = "deg/s"', ".vel"),
        ('<velocity name="e" joint="elbow" kv="2"/>', f'kind = "velocity"\nunit = "ticks"\nscale = {DEGREE}', ".vel"),
        ('<position name="e" joint="elbow" kp="5" kv="1"/>', 'unit = "deg/s"\njoints.elbow.unit = "deg"', ".pos"),
        ('<motor name="e" joint="elbow"/>', 'unit = "deg/s"\njoints.elbow.unit = "N·m"', ".effort"),
    ],
)
def test_a_log_of_velocity_commands_is_predicted_by_the_servo_that_takes_them(tmp_path, elbow, command, second):
    model = mujoco.MjModel.from_xml_string(VELOCITY_ARM.format(elbow=elbow))
    data, rows, time = mujoco.MjData(model), [], np.arange(151) / 50
    goals = np.column_stack([np.sin(3 * time), 0.02 * np.cos(4 * time)])
    for goal in goals:
        rows.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, 10)
    states, logged = np.array(rows), goals * [180 / np.pi, 1.0 if second == ".effort" else 180 / np.pi]
    log = write_log(tmp_path / "log.npz", {"t": time, "q": states[:, :2], "dq": states[:, 2:], "goal": logged})
    dataset = import_logs([log], sample_map(tmp_path, command=f'column = "goal"\n{command}')).dataset
    assert dataset.kinds == (".vel", second)
    (tmp_path / "arm.xml").write_text(VELOCITY_ARM.format(elbow=elbow))
    paired = pair(dataset, MujocoSimulator.load(tmp_path / "arm.xml", 1 / 50, dataset.joints))
    np.testing.assert_allclose(paired.sim_states, paired.next_states, atol=1e-5)


def test_a_kind_that_its_unit_denies_is_answered_with_the_units_that_fit(tmp_path):
    with pytest.raises(MapError, match="'kind' is 'velocity' but 'unit' is 'deg'; choose one of: rad/s, deg/s"):
        sample_map(tmp_path, command='column = "goal"\nunit = "deg"\nkind = "velocity"')


def test_the_example_map_reads_what_its_comments_describe(tmp_path):
    rows, takes = 303, 3
    time = np.arange(rows) * 10.0
    angle = 0.8 * np.sin(np.arange(rows) * 0.05)
    speed = 0.8 * 0.05 * 100 * np.cos(np.arange(rows) * 0.05)
    goal = 0.8 * np.sin((np.arange(rows) + 1) * 0.05)
    columns = {
        "time": 1e6 + time,
        "take": np.repeat(np.arange(takes), rows // takes),
        "q1": np.degrees(angle),
        "q2": 2048 - angle / (2 * np.pi / 4096),
        "dq1": speed * 60 / (2 * np.pi),
        "dq2": -speed * 60 / (2 * np.pi),
        "goal": np.column_stack([goal, goal - 0.1]),
        "load1": np.full(rows, 100),
        "load2": np.full(rows, 1024 + 100),
        "volts": np.full(rows, 7.5),
        "payload": np.full(rows, 0.2),
    }
    result = import_logs([write_log(tmp_path / "demo.csv", columns)], load_map("example_csv"))
    dataset = result.dataset
    assert [finding.check for finding in result.findings] == []
    assert dataset.tasks == tuple(f"demo:{take} with 0.2 kg" for take in range(takes))
    assert dataset.fps == 50.0 and dataset.lengths.tolist() == [50] * takes
    first = dataset.episode(1)
    expected = angle[101:201:2]
    np.testing.assert_allclose(dataset.states[first][:, :2], np.column_stack([expected, expected]), atol=1e-5)
    np.testing.assert_allclose(dataset.states[first][:, 2], speed[101:201:2], atol=1e-5)
    np.testing.assert_allclose(dataset.commands[first], np.column_stack([goal[101:201:2]] * 2), atol=1e-5)
    assert dataset.columns["nas.load"][0].tolist() == pytest.approx([0.1, -0.1])
    assert dataset.columns["nas.voltage"].shape == (150, 1)


def import_load(folder: Path, counts: np.ndarray, signal: str):
    """Import a log with a register of counts."""
    log = write_log(folder / "log.npz", columns_of(motion()) | {"load": counts})
    return import_logs([log], sample_map(folder, ".npz", signal))


def test_unsigned_registers_are_decoded_and_impossible_counts_refused(tmp_path):
    counts = np.array([[0, 1], [885, 65536 - 885], [32767, 32768]] * 40, dtype=np.int64)
    signal = '[signals.load]\ncolumn = "load"\nencoding = "int16"\nscale = 0.5\nunit = "duty"'
    dataset = import_load(tmp_path, counts, signal).dataset
    assert dataset.columns["nas.load"][:3].tolist() == [[0, 0.5], [442.5, -442.5], [16383.5, -16384]]
    with pytest.raises(LogError, match=r"'load' in row 7 \(counted from 0\) is not within 0 … 65535"):
        counts[7] = -3
        import_load(tmp_path, counts, signal)


def test_the_xl320_sign_stands_in_bit_10(tmp_path):
    counts = np.array([[5, 1024 + 5]] * 120)
    signal = '[signals.load]\ncolumn = "load"\nencoding = "sign_magnitude_10"\nunit = "counts"'
    dataset = import_load(tmp_path, counts, signal).dataset
    assert dataset.columns["nas.load"][0].tolist() == [5, -5]
