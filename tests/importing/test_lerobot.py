"""LeRobot datasets as they come: units, clocks, cameras; what is refused names a command that works."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq
import pytest
from support.command_samples import refused
from support.lerobot_samples import (
    ARM,
    JOINTS,
    RATE,
    SO101,
    enter_with_arm,
    from_ticks,
    motions,
    stamp,
    write_calibration,
    write_lerobot,
)

from nas_data.cli import main
from nas_data.dataset.features import TIME
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.importing.map_file import MAPS, load_map
from nas_data.simulators.against_model import check

pytest.importorskip("lerobot")
SERVO = 4096  # [ticks a turn]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    return enter_with_arm(tmp_path, monkeypatch)


def scaled(factor) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(states * factor, commands * factor) for states, commands in motions()]


def imported(*arguments: str) -> Path:
    """Import and return the dataset's folder."""
    out = Path(f"i{len(list(Path().glob('i[0-9]*')))}")
    assert main(["import", *arguments, "--out", str(out)]) == 0
    return out


def remedies(error: str) -> list[list[str]]:
    """Return the commands that an error names."""
    found = re.findall(r"nas (import .+?)(?= divides|\)|\.$|;|$)", error.strip())
    assert found, error
    return [shlex.split(command) for command in found]


# Units


def test_degrees_and_ranges_are_the_same_numbers_as_radians(here, capsys):
    motors = write_calibration(here / "cal.json", JOINTS, turned=("j2",))
    factors = [
        (-1 if motor["drive_mode"] else 1) * 4095 / 360 * 200 / (motor["range_max"] - motor["range_min"]) * 180 / np.pi
        for motor in motors.values()
    ]
    plain = imported(str(write_lerobot(here / "rad", motions())))
    degrees = imported(str(write_lerobot(here / "deg", scaled(180 / np.pi))), "--unit", "deg")
    write_lerobot(here / "norm", scaled(np.array(factors)))
    ranges = imported("norm", "--unit", "range", "--calibration", "cal.json")
    assert json.loads((ranges / "meta/calibration.json").read_text()) == motors
    first = read(plain)
    for other in (read(degrees), read(ranges)):
        assert other.tasks == first.tasks == ("pick 0", "pick 1", "pick 0") and other.joints == JOINTS
        for key in ("observation.state", "action", "next.observation.state"):
            np.testing.assert_allclose(other.columns[key], first.columns[key], rtol=2e-6, atol=2e-5, err_msg=key)
    gaps = []
    capsys.readouterr()
    for folder in (plain, degrees, ranges):
        assert main(["gap", "find", str(folder), "--model", "arm.xml", "--json"]) == 0
        gaps.append(json.loads(capsys.readouterr().out))
    for other in gaps[1:]:
        for joint in JOINTS:
            assert other["joints"][joint]["one_step"] == pytest.approx(gaps[0]["joints"][joint]["one_step"], rel=0.01)


def test_an_import_records_how_values_were_read(here):
    motors = write_calibration(here / "cal.json", JOINTS, turned=("j2",))
    write_lerobot(here / "d", scaled(30.0))
    options = {
        "rad": ["--unit", "rad", "--unwrap"],
        "deg": ["--unit", "deg", "--cut", "0.4"],
        "range": ["--unit", "range", "--calibration", "cal.json"],
    }
    gains = {}
    for unit, given in options.items():
        if unit == "rad":
            write_lerobot(here / "r", motions())
        folder = imported("r" if unit == "rad" else "d", *given)
        provenance = read_provenance(folder)
        read_as = provenance.signal["conversion"]["position"]
        assert {line["unit"] for line in read_as.values()} == {unit}
        gains[unit] = [line["gain"] for line in read_as.values()]
        assert provenance.signal["options"]["unit"] == unit
        assert "as given by --unit" in provenance.signal["decisions"][0]
        head = (folder / "meta/import_map.toml").read_text().splitlines()[0]
        assert head.startswith("# Positions that this map gives in degrees were read as") is (unit != "deg")
        assert "state of the following frame" in provenance.derived["next.observation.state"]
        assert "velocities" in provenance.derived["next.observation.state"]
    spans = [motor["range_max"] - motor["range_min"] for motor in motors.values()]
    signs = [-1 if motor["drive_mode"] else 1 for motor in motors.values()]
    assert gains["rad"] == pytest.approx([1.0] * 2)
    assert gains["deg"] == pytest.approx([np.pi / 180] * 2)
    expected = [sign * span / 200 * 2 * np.pi / 4095 for sign, span in zip(signs, spans, strict=True)]
    assert gains["range"] == pytest.approx(expected)


def so101(unit: str, motors: dict, rng: np.random.Generator) -> tuple[list, np.ndarray]:
    """Two episodes of six motors read in ticks, and the angles about the middles of their ranges [rad]."""
    ticks = 2000 + np.cumsum(rng.integers(-12, 13, (80, 6)), axis=0)
    stored = [
        from_ticks(ticks[:, index], motor, "percent" if joint == "gripper" else unit)
        for index, (joint, motor) in enumerate(motors.items())
    ]
    middles = np.array([(motor["range_min"] + motor["range_max"]) / 2 for motor in motors.values()])
    episode = np.array(stored).T
    return [(episode[:40], episode[:40]), (episode[40:], episode[40:])], np.radians((ticks - middles) * 360 / 4095)


@pytest.mark.parametrize("turned", [(), ("elbow_flex", "gripper")])
@pytest.mark.parametrize("unit", ["deg", "range"])
def test_the_map_of_the_so101_tells_the_unit_by_the_servos_ticks(here, capsys, unit, turned):
    motors = write_calibration(here / "cal.json", SO101, turned)
    episodes, truth = so101(unit, motors, np.random.default_rng(1))
    write_lerobot(here / "d", episodes, SO101, "so101_follower")
    dataset = read(imported("d", "--map", "so101_lerobot", "--calibration", "cal.json"))
    assert ("Read as degrees" if unit == "deg" else "Read as −100 … 100") in capsys.readouterr().out
    assert dataset.joints == SO101 and dataset.fps == RATE
    states = np.concatenate([dataset.states[:39, :6], dataset.states[39:, :6]])
    wanted = np.concatenate([truth[:39], truth[40:79]])
    np.testing.assert_allclose(states[:, :5], wanted[:, :5], atol=1e-5)
    gripper = motors["gripper"]
    share = (wanted[:, 5] / np.radians(360 / 4095)) / (gripper["range_max"] - gripper["range_min"]) + 0.5
    low, high = -0.17453297762778586, 1.7453291995659765
    np.testing.assert_allclose(states[:, 5], low + share * (high - low), atol=1e-5)


def test_degrees_of_an_earlier_lerobot_are_told_by_its_ticks(here, capsys):
    motors = write_calibration(here / "cal.json", SO101)
    episodes, truth = so101("deg", motors, np.random.default_rng(1))
    earlier = np.array([4095 / 4096] * 5 + [1])
    write_lerobot(here / "d", [(s * earlier, c * earlier) for s, c in episodes], SO101, "so101_follower")
    dataset = read(imported("d", "--map", "so101_lerobot"))
    assert "Read as degrees (readings are the servo's ticks" in capsys.readouterr().out
    np.testing.assert_allclose(dataset.states[:39, :5], truth[:39, :5] * 4095 / 4096, atol=1e-5)


def test_ranges_without_a_calibration_are_refused_and_the_remedy_works(here):
    motors = write_calibration(here / "FILE", SO101)
    episodes, _ = so101("range", motors, np.random.default_rng(1))
    write_lerobot(here / "d", episodes, SO101, "so101_follower")
    assert "--calibration FILE" in refused("import", "d", "--map", "so101_lerobot")
    assert main(["import", "d", "--map", "so101_lerobot", "--calibration", "FILE", "--out", "done"]) == 0


@pytest.mark.parametrize(
    ("robot", "command"),
    [
        ("so101_follower", "gap find"),
        ("so_follower", "pair"),
        ("so100_follower", "train forward"),
        ("koch_follower", "gap find"),
        ("arm2", "pair"),
    ],
)
def test_degrees_are_answered_with_the_command_that_imports_them(here, robot, command):
    joints = JOINTS if robot == "arm2" else SO101
    episodes = [(np.resize(s, (60, len(joints))), np.resize(c, (60, len(joints)))) for s, c in scaled(180 / np.pi)]
    write_lerobot(here / "d", episodes, joints, robot)
    model = [] if command == "train forward" else ["--model", "arm.xml"]
    (remedy,) = remedies(refused(*command.split(), "d", *model))
    assert main([*remedy, "--out", "done"]) == 0
    dataset = read(here / "done")
    assert np.abs(dataset.states[:, 0]).max() < 2 and verify(here / "done") == []


def test_readings_beyond_100_are_degrees_and_others_may_be_ranges(here):
    write_calibration(here / "FILE", JOINTS)
    write_lerobot(here / "far", [(s * 150, c * 150) for s, c in scaled(1)], JOINTS, "arm2")
    assert "--unit range" not in refused("pair", "far", "--model", "arm.xml")
    write_lerobot(here / "near", [(s * 50, c * 50) for s, c in scaled(1)], JOINTS, "arm2")
    said = refused("pair", "near", "--model", "arm.xml")
    options = re.search(r"--unit range --calibration FILE", said)[0].split()
    assert main(["import", "near", *options, "--out", "done"]) == 0


def test_the_shipped_names_may_be_short():
    assert load_map("koch") == load_map("koch_lerobot") and load_map("so100") == load_map("so100_lerobot")


# Clocks


CLOCKS = {
    "slow": lambda k: k * 0.04,
    "hole": lambda k: k * 0.02 + (k >= 40) * 1.0,
    "back": lambda k: k * 0.02 - (k == 30) * 0.1,
    "coarse": lambda k: k // 3 * 0.06,
}


@pytest.mark.parametrize(
    ("clock", "command"), [("slow", "gap find"), ("hole", "pair"), ("back", "train forward"), ("coarse", "pair")]
)
def test_a_clock_that_denies_the_rate_is_refused_and_every_remedy_works(here, capsys, clock, command):
    stamp(write_lerobot(here / "d", motions()), CLOCKS[clock])
    model = [] if command == "train forward" else ["--model", "arm.xml"]
    error = refused(*command.split(), "d", *model)
    assert main(["info", "d"]) == 0
    assert "not usable as it is" in capsys.readouterr().out
    for number, remedy in enumerate(remedies(error)):
        assert main([*remedy, "--out", f"r{number}"]) == 0
        assert verify(here / f"r{number}") == []
        assert main(["pair", f"r{number}", "--model", "arm.xml", "--out", f"p{number}"]) == 0


UNEVEN = {"same": lambda k: k * 0.0, "jitter": lambda k: k * 0.02 + (k % 3) * 0.006}


@pytest.mark.parametrize("said", [("--unit", "rad"), ("--map", "own.toml"), ()], ids=["unit", "map", "neither"])
@pytest.mark.parametrize("clock", ["slow", "back", "coarse", *UNEVEN])
def test_what_an_import_says_of_a_clock_can_be_said_to_it(here, capsys, clock, said):
    """Whether the numbers are explained by an option, by a map or by nothing."""
    stamp(write_lerobot(here / "d", motions()), {**CLOCKS, **UNEVEN}[clock])
    text = (MAPS / "example_lerobot.toml").read_text()
    joints = re.sub(r"(?m)^joints = .*", 'joints = ["j1", "j2"]', text.partition("\n[")[0])
    quantities = "".join(f'[read.{name}]\nunit = "rad"\n' for name in ("position", "command"))
    (here / "own.toml").write_text(f"{joints}\n{quantities}")
    status = main(["import", "d", *said, "--out", "first"])
    captured = capsys.readouterr()
    told = captured.err + captured.out
    assert (status == 0) is (clock == "jitter"), told
    options = sorted(set(re.findall(r"--(?:rate [\d.]+\d|uniform)", told)))
    assert len(options) == (2 if clock == "slow" else 1), told
    assert said == ("--map", "own.toml") or not re.search(r"\[|the map", told), told
    for number, option in enumerate(options):
        assert main(["import", "d", *said, *option.split(), "--out", f"r{number}"]) == 0, capsys.readouterr().err
        assert "Warning" not in capsys.readouterr().out
    if said == ("--map", "own.toml") and clock in ("slow", "jitter"):
        assert "add [resample] to the map" in told
        (here / "own.toml").write_text(f'{joints}\n{quantities}[resample]\nrate = 25.0\nmethod = "linear"\n')
        assert main(["import", "d", *said, "--out", "resampled"]) == 0


def test_a_remedy_that_only_a_map_has_says_so_where_there_is_none(here, capsys):
    write_lerobot(here / "d", [(states, -commands) for states, commands in motions()])
    imported("d")
    assert "in a map of your own (--map): check 'sign' in [read.command]" in capsys.readouterr().out


def test_a_hole_divides_the_episodes_and_the_clock_is_kept(here, capsys):
    stamp(write_lerobot(here / "d", motions()), CLOCKS["hole"])
    dataset = read(imported("d"))
    assert dataset.lengths.tolist() == [39, 19] * 3
    assert "1.02 s are missing before row 40" in capsys.readouterr().out
    np.testing.assert_allclose(dataset.columns[TIME][39:58, 0], np.arange(19) * 0.02, atol=1e-5)


def test_a_clock_that_only_jitters_is_a_warning_and_kept(here, capsys):
    stamp(write_lerobot(here / "d", motions()), lambda k: k * 0.02 + (k % 3) * 0.006)
    assert main(["pair", "d", "--model", "arm.xml", "--out", "p"]) == 0
    assert (
        "warning: in episode 0 the step before rows 3, 6, 9, 12, 15 and 14 more places (counted from 0) is 8 ms instead"
        in capsys.readouterr().err
    )
    assert main(["info", "d"]) == 0
    assert "warning: in episode 0 the step before" in capsys.readouterr().out
    folder = imported("d")
    assert "Warning irregular_time" in capsys.readouterr().out
    time = read(folder).columns[TIME][:59, 0]
    k = np.arange(59)
    np.testing.assert_allclose(time, k * 0.02 + (k % 3) * 0.006, atol=1e-6)
    assert "irregular_time" in read_provenance(folder).notes


def test_wraps_and_frozen_readings_are_reported(here, capsys):
    episodes = motions(rows=100)
    episodes[0][0][30:, 0] -= 2 * np.pi
    episodes[1][0][3:, 1] = episodes[1][0][3, 1]
    write_lerobot(here / "d", episodes)
    imported("d")
    out = capsys.readouterr().out
    assert "import with --unwrap" in out and "the reading of j2 is constant" in out
    assert main(["pair", "d", "--model", "arm.xml", "--out", "p"]) == 0
    assert "j1 reaches" in capsys.readouterr().err


def test_episodes_are_cut_in_time(here):
    write_lerobot(here / "d", motions())
    assert read(imported("d", "--cut", "0.4")).lengths.tolist() == [20, 39] * 3


# Signs and zeros


def test_a_joint_whose_sign_or_zero_contradicts_the_model_is_reported(here, capsys):
    def held(flip: float = 1.0, zero: float = 0.0):
        """Poses that are held against gravity, the first joint turned round or moved."""
        model_states, commands = zip(*motions(6, 80), strict=True)
        pair = [np.array([flip, 1.0]), np.array([zero, 0.0])]
        return [(s * pair[0] + pair[1], c * pair[0] + pair[1]) for s, c in zip(model_states, commands, strict=True)]

    write_lerobot(here / "right", held())
    write_lerobot(here / "turned", held(flip=-1.0))
    write_lerobot(here / "moved", held(zero=2.0))
    assert check(read(imported("right")), "arm.xml") == []
    assert {finding.check for finding in check(read(imported("turned")), "arm.xml")} == {"model_gravity"}
    capsys.readouterr()
    assert main(["import", "moved", "--model", "arm.xml", "--out", "m"]) == 0
    out = capsys.readouterr().out
    assert "beyond the model's range" in out and "with another zero it would be inside" in out


@pytest.mark.parametrize("moved", [(0.6, 0.0), (0.0, 1.0), (-0.4, 0.0)])
def test_a_wrong_zero_is_told_by_the_loads_alone(here, moved):
    recorded = [(states + moved, commands + moved) for states, commands in motions(6, 80)]
    write_lerobot(here / "d", recorded)
    Path("free.xml").write_text(ARM.replace(' range="-2 2"', ""))
    joint = JOINTS[int(np.flatnonzero(moved)[0])]
    (finding,) = check(read(imported("d")), "free.xml")
    said = re.search(rf"they do if {joint} is moved by (\S+) rad$", finding.what)
    assert finding.check == "model_gravity"
    assert float(said[1]) == pytest.approx(-sum(moved), abs=0.2)


SO_RANGES = {  # of MuJoCo Menagerie's trs_so_arm100
    "Rotation": (-2.2, 2.2), "Pitch": (-3.14158, 0.2), "Elbow": (0, 3.14158), "Wrist_Pitch": (-2.0, 1.8),
    "Wrist_Roll": (-3.14158, 3.14158), "Jaw": (-0.2, 2.0),
}  # fmt: skip
KOCH_RANGES = {  # of MuJoCo Menagerie's low_cost_robot_arm
    "base_rotation": (-2.2, 2.2), "pitch": (-1.57, 0.6), "elbow": (-1.57, 1.45), "wrist_pitch": (-2.0, 2.0),
    "wrist_roll": (-3.14, 3.14), "gripper": (-1.6, 0.032),
}  # fmt: skip


def write_chain(path: Path, ranges: dict[str, tuple[float, float]]) -> None:
    """Write an arm of joints with ranges."""
    links = "".join(
        f'<body pos="0.1 0 0"><joint name="{joint}" axis="0 1 0" range="{low} {high}"/><geom size="0.01" mass="0.1"/>'
        for joint, (low, high) in ranges.items()
    )
    servos = "".join(f'<position joint="{joint}" kp="20"/>' for joint in ranges)
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{links}{"</body>" * len(ranges)}</worldbody>'
        f"<actuator>{servos}</actuator></mujoco>"
    )


@pytest.mark.parametrize("name,ranges,off", [("so100", SO_RANGES, 2), ("koch", KOCH_RANGES, 1)])
def test_the_zeros_that_a_map_names_for_a_model_are_that_models(here, capsys, name, ranges, off):
    """The lines that stand as comments in the map are put to use: without them the zeros are reported."""
    rng = np.random.default_rng(0)
    poses = np.c_[rng.uniform(-40, 40, (80, 5)), rng.uniform(0, 100, 80)]
    write_lerobot(here / "d", [(poses, poses)], SO101, robot=f"{name}_follower")
    write_chain(here / "arm.xml", ranges)
    shipped = (MAPS / f"{name}_lerobot.toml").read_text()
    lines = {key: re.search(rf"^#   ({key} = .*)$", shipped, re.M)[1] for key in ("joints", "names", "offset")}
    shipped = re.sub(r"^joints = .*$", lines["joints"], shipped, flags=re.M)
    shipped = shipped.replace("joints.gripper]", f"joints.{[*ranges][-1]}]")
    for file, keys in (("named", ("names",)), ("right", ("names", "offset"))):
        added = "\n".join(['unit = "deg"', *(lines[key] for key in keys)])
        Path(f"{file}.toml").write_text(shipped.replace('unit = "deg"', added))
    found = {}
    for file in ("named", "right"):
        capsys.readouterr()
        options = ["--unit", "deg", "--map", f"{file}.toml", "--model", "arm.xml", "--json"]
        assert main(["import", "d", *options, "--out", file]) == 0
        found[file] = [one for one in json.loads(capsys.readouterr().out)["audit"] if one["check"] == "model_zero"]
    assert len(found["named"]) == off and "check 'offset' of" in found["named"][0]["message"]
    assert found["right"] == []


# Cameras, texts, tasks


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Path:
    return write_lerobot(tmp_path_factory.mktemp("filmed") / "cam", scaled(180 / np.pi), camera=True)


def seen(root: Path, row: int) -> dict[str, object]:
    """What LeRobot itself shows of a frame."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("nas/test", root=root, video_backend="pyav")[row]


def check_pictures(root: Path, frames: dict[int, int], tasks: dict[int, str]) -> None:
    """Every camera, text and matrix of some frames is that of the row it was recorded in."""
    for frame, row in frames.items():
        item = seen(root, frame)
        assert item["language"] == f"row {row}" and item["task"] == tasks[frame]
        assert np.allclose(item["grid"], row)
        for camera in ("front", "wrist"):
            assert float(item[f"observation.images.{camera}"].mean()) == pytest.approx(4 * row / 255, abs=0.012)


def test_cameras_texts_and_tasks_survive_import_split_merge_and_pack(here, filmed):
    folder = imported(str(filmed), "--unit", "deg")
    assert verify(folder) == []
    check_pictures(folder, {0: 0, 58: 58, 59: 0, 100: 41}, {0: "pick 0", 58: "pick 0", 59: "pick 1", 100: "pick 1"})
    (video,) = folder.rglob("*.mp4")
    (original,) = filmed.rglob("*.mp4")
    assert video.read_bytes() == original.read_bytes()
    assert main(["split", str(folder), "--episodes", "1", "--names", "one", "rest"]) == 0
    (one,), (rest,) = (list((here / "datasets" / name).iterdir()) for name in ("one", "rest"))
    check_pictures(one, {0: 0, 30: 30}, {0: "pick 1", 30: "pick 1"})
    assert main(["merge", str(one), str(rest), "--out", "merged"]) == 0
    check_pictures(here / "merged", {5: 5, 59: 0, 70: 11}, {5: "pick 1", 59: "pick 0", 70: "pick 0"})
    assert main(["pack", "merged", "--out", "d.nas.tar"]) == 0
    assert main(["unpack", "d.nas.tar", "--folder", "far"]) == 0
    (unpacked,) = (here / "far/merged").iterdir()
    check_pictures(unpacked, {5: 5, 70: 11}, {5: "pick 1", 70: "pick 0"})
    for root in (one, here / "merged", unpacked):
        assert verify(root) == []
    assert main(["pair", str(folder), "--model", "arm.xml", "--out", "paired"]) == 0
    check_pictures(here / "paired", {100: 41}, {100: "pick 1"})


def test_parts_of_episodes_keep_their_pictures(here, filmed):
    folder = imported(str(filmed), "--unit", "deg", "--cut", "0.4")
    dataset = read(folder)
    assert dataset.lengths.tolist() == [20, 39] * 3
    check_pictures(folder, {20: 20, 58: 58, 79: 20}, {20: "pick 0", 58: "pick 0", 79: "pick 1"})


def lose_the_last_episode(root: Path) -> None:
    (path,) = (root / "data").rglob("*.parquet")
    table = pq.read_table(path)
    pq.write_table(table.filter(pa.compute.less(table["episode_index"], 2)), path)


def test_pictures_of_the_episodes_that_are_whole_are_rescued(here, filmed):
    shutil.copytree(filmed, here / "damaged")
    lose_the_last_episode(here / "damaged")
    assert main(["recover", "damaged", "--out", "rescued"]) == 0
    assert read(here / "rescued").lengths.tolist() == [60, 60]
    check_pictures(
        here / "rescued", {0: 0, 59: 59, 60: 0, 119: 59}, {0: "pick 0", 59: "pick 0", 60: "pick 1", 119: "pick 1"}
    )
    assert verify(here / "rescued") == []


def test_a_killed_recording_keeps_its_videos(here, capsys):
    """LeRobot saved three episodes and was killed: a data file without its end, no table of episodes, whole videos."""
    write_lerobot(here / "d", scaled(180 / np.pi), camera=True, only_video=True, killed=True)
    assert not list((here / "d/meta/episodes").glob("*/*.parquet"))
    assert main(["recover", "d", "--out", "rescued"]) == 0
    assert "left out" not in capsys.readouterr().out
    assert read(here / "rescued").lengths.tolist() == [60, 60, 60]
    for frame in (0, 59, 60, 100, 179):
        item = seen(here / "rescued", frame)
        assert item["task"] == f"pick {frame // 60 % 2}"
        assert float(item["observation.images.front"].mean()) == pytest.approx(4 * (frame % 60) / 255, abs=0.012)
    assert verify(here / "rescued") == []
    (video,) = (here / "d").rglob("*.mp4")
    video.write_bytes(video.read_bytes()[:2000])
    assert main(["recover", "d", "--out", "blind"]) == 0
    assert f"{video.name} is not a complete video file" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [
        ("meta/episodes/*/*.parquet", "meta/episodes does not give the position of the video frames of episode 0"),
        ("videos/*/*/*.mp4", "file-000.mp4 is missing"),
    ],
)
def test_pictures_that_cannot_be_rescued_are_named_with_their_place(here, filmed, pattern, reason, capsys):
    shutil.copytree(filmed, here / "damaged")
    lose_the_last_episode(here / "damaged")
    for path in (here / "damaged").glob(pattern):
        path.unlink()
    assert main(["recover", "damaged", "--out", "rescued"]) == 0
    (said,) = [line for line in capsys.readouterr().out.splitlines() if "left out" in line]
    assert "'observation.images.front' (video" in said and reason in said and "damaged/videos" in said
    assert read(here / "rescued").passthrough is None
    assert verify(here / "rescued") == []


@pytest.mark.slow
def test_two_commands_lead_from_a_filmed_dataset_to_the_report_that_the_log_in_radians_gives(here):
    motors = write_calibration(here / "cal.json", JOINTS, turned=("j2",))
    factors = np.degrees(
        [
            (-1 if motor["drive_mode"] else 1) * 4095 / 360 * 200 / (motor["range_max"] - motor["range_min"])
            for motor in motors.values()
        ]
    )
    Path("model.xml").write_text(ARM.replace('kp="2"', 'kp="1.25"', 1))
    units = {
        "rad": (1.0, []),
        "deg": (180 / np.pi, ["--unit", "deg"]),
        "range": (factors, ["--unit", "range", "--calibration", "cal.json"]),
    }
    reports = {}
    for name, (factor, said) in units.items():
        episodes = [(states * factor, commands * factor) for states, commands in motions(6, 150)]
        write_lerobot(here / name, episodes, camera=True)
        assert main(["import", name, *said, "--out", f"{name}_imported"]) == 0
        assert main(["gap", f"{name}_imported", "--model", "model.xml", "--out", f"{name}_gap"]) == 0
        reports[name] = json.loads(Path(f"{name}_gap/report.json").read_text())
    for report in reports.values():
        (found,) = report["effects"]
        assert (report["verdict"], found["effect"], found["joint"]) == ("explained", "servo_stiffness", "j1")
        assert found["parameters"]["factor"]["value"] == pytest.approx(1.6, rel=1e-3)
        for key in ("noise_floor", "before"):
            assert report["gap"][key] == pytest.approx(reports["rad"]["gap"][key], rel=1e-5)


def said_by_checkers(root: Path) -> set[tuple[str, str]]:
    """What lerobot-doctor and robovet find wrong or warn of."""
    from lerobot_doctor.dataset_loader import load_dataset
    from lerobot_doctor.runner import Severity, run_checks
    from robovet.checks import run_doctor
    from robovet.dataset import load_dataset as load

    messages = [m for result in run_checks(load_dataset(str(root))).results for m in result.messages]
    found = {(m.severity.value, m.message) for m in messages if m.severity != Severity.PASS}
    results = run_doctor(load(root)).results
    return found | {(r.severity.label, r.summary) for r in results if r.severity.label in ("WARN", "FAIL")}


def test_two_public_checkers_find_nothing_wrong_with_what_we_write(here):
    time = np.arange(150)[:, None] / RATE
    angles = [40 * np.sin(time * [2.1, 2.9] + number) for number in range(3)]
    theirs = write_lerobot(here / "d", [(angle, angle + 1) for angle in angles], camera=True, only_video=True)
    folder = imported("d", "--unit", "deg")
    assert main(["split", str(folder), "--episodes", "1", "--names", "one", "rest"]) == 0
    (one,) = (here / "datasets/one").iterdir()
    for root in (folder, one):
        more = said_by_checkers(root) - said_by_checkers(theirs)
        # Videos are never encoded again, so they keep the pictures of frames that are in no transition.
        assert all(re.search(r"\.mp4 has 450 frames, expected (447|149)", sentence) for _, sentence in more), more
        assert {one for one in said_by_checkers(root) if one[0] == "FAIL"} == set()


def test_a_gripper_of_a_robot_without_a_map_takes_its_range_from_the_model(here):
    names = ("j1", "gripper")
    episodes = [(np.column_stack([s[:, 0] * 57, 50 + 40 * np.sin(s[:, 1])]),) * 2 for s, _ in motions()]
    write_lerobot(here / "d", episodes, names)
    (here / "arm.xml").write_text(ARM.replace("j2", "gripper"))
    said = refused("pair", "d", "--model", "arm.xml")
    assert "−100 … 100 need --unit range --calibration FILE" in said
    assert said.strip().endswith("import it: nas import d --unit deg --model MODEL.xml.")
    assert "add --model" in refused("import", "d", "--unit", "deg")
    dataset = read(imported("d", "--unit", "deg", "--model", "arm.xml"))
    wanted = -2 + 4 * episodes[0][0][:59, 1] / 100
    np.testing.assert_allclose(dataset.states[:59, 1], wanted, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "robot"),
    [("Gripper", "arm2"), ("left gripper", "arm2"), ("left.gripper", "arm2"), ("gripper", 'my "arm"')],
)
def test_grippers_of_any_name_are_read_as_percent_and_named(here, capsys, name, robot):
    """Names that TOML must quote, in capitals or not."""
    episodes = [(np.column_stack([s[:, 0] * 57, 50 + 40 * np.sin(s[:, 1])]),) * 2 for s, _ in motions()]
    write_lerobot(here / "d", episodes, ("j1", name), robot)
    (here / "arm.xml").write_text(ARM.replace('"j2"', f'"{name}"'))
    folder = imported("d", "--unit", "deg", "--model", "arm.xml")
    assert f"Read as a share of the joint's range, 0 … 100 in LeRobot: {name}." in capsys.readouterr().out
    wanted = -2 + 4 * episodes[0][0][:59, 1] / 100
    np.testing.assert_allclose(read(folder).states[:59, 1], wanted, atol=1e-5)


def test_radians_by_the_map_of_degrees_are_refused_and_the_remedy_works(here):
    episodes = [(np.resize(s, (60, 6)), np.resize(c, (60, 6))) for s, c in motions()]
    write_lerobot(here / "d", episodes, SO101, "so101_follower")
    assert "use --unit rad" in refused("import", "d", "--map", "so101_lerobot")
    dataset = read(imported("d", "--map", "so101_lerobot", "--unit", "rad"))
    np.testing.assert_allclose(dataset.states[:59, :6], episodes[0][0][:59], atol=1e-6)
    np.testing.assert_allclose(dataset.commands[:59], episodes[0][1][:59], atol=1e-6)


def test_a_gripper_in_percent_beside_radians_is_refused_with_the_table_of_its_unit(here):
    episodes = [(np.resize(s, (60, 6)), np.resize(c, (60, 6))) for s, c in motions()]
    for states, commands in episodes:
        states[:, 5] = commands[:, 5] = 50 + 10 * states[:, 5]
    write_lerobot(here / "d", episodes, SO101, "so101_follower")
    said = refused("import", "d", "--map", "so101_lerobot", "--unit", "rad")
    assert "the position of gripper reaches" in said and "[read.position.joints.gripper]" in said


def test_a_robot_that_lerobot_records_in_degrees_is_not_imported_as_radians_unasked(here):
    episodes = [(np.resize(s, (60, 6)), np.resize(c, (60, 6))) for s, c in motions()]
    write_lerobot(here / "d", episodes, SO101, "so101_follower")
    said = refused("import", "d")
    assert "d stores no unit, and LeRobot records a so101_follower in degrees or −100 … 100" in said
    by_map, radians = remedies(said)
    assert by_map == ["import", "d", "--map", "so101_lerobot"]
    assert main([*radians, "--out", "done"]) == 0
    np.testing.assert_allclose(read(here / "done").states[:59, :6], episodes[0][0][:59], atol=1e-6)


@pytest.mark.parametrize("resolution", [4095, 4096])
def test_small_motions_in_degrees_are_told_by_the_servos_ticks(here, resolution):
    step = 360 / resolution
    write_lerobot(here / "d", [(np.round(s * 5 / step) * step, c * 5) for s, c in motions()])
    said = refused("pair", "d", "--model", "arm.xml")
    assert "of joint j1 are multiples of 0.0879, as of a servo that is read in degrees" in said
    assert "import it: nas import d --unit deg" in said


def test_a_joint_that_holds_still_in_radians_is_on_no_grid(here):
    noise = np.random.default_rng(0).normal(0, 2e-4, 60)
    episodes = [(np.stack([s[:, 0], 0.7 + np.resize(noise, len(s))], axis=1), c) for s, c in motions()]
    write_lerobot(here / "d", episodes)
    assert main(["pair", "d", "--model", "arm.xml", "--out", "p"]) == 0


def test_radians_are_assumed_with_a_warning_and_stored_as_it_says(here, capsys):
    write_lerobot(here / "d", motions())
    assert main(["pair", "d", "--model", "arm.xml", "--out", "p"]) == 0
    said = capsys.readouterr().err
    assert "d stores no unit: taken as radians" in said
    assert remedies(said)[0] == ["import", "d", "--unit", "rad"]
    folder = imported("d", "--unit", "rad")
    capsys.readouterr()
    assert main(["pair", str(folder), "--model", "arm.xml", "--out", "again"]) == 0
    assert "stores no unit" not in capsys.readouterr().err


@pytest.mark.parametrize("command", ["import d", "pair d --model arm.xml"])
def test_commands_in_degrees_beside_radians_are_refused_without_a_map_too(here, command):
    time = np.arange(120)[:, None] / RATE
    states = 0.15 * np.sin(time * [2.1, 2.9])
    write_lerobot(here / "d", [(states, np.degrees(np.roll(states, -1, axis=0)))])
    said = refused(*command.split())
    assert "moves 57" in said and "factor between degrees and radians" in said and "[read.command]" in said


def test_joints_of_several_turns_are_taken_where_it_is_said_and_used_throughout(here):
    write_lerobot(here / "d", scaled(20.0))
    assert main(["pair", "d", "--model", "arm.xml", "--out", "p"]) == 2
    folder = imported("d", "--unit", "rad")
    assert np.abs(read(folder).states[:, :2]).max() > 4 * np.pi
    assert verify(folder) == []
    for command in (["pair", str(folder), "--out", "p"], ["gap", "find", str(folder)]):
        assert main([*command, "--model", "arm.xml"]) == 0
