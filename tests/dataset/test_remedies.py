"""A dataset that is refused is taken once it is changed, or the command run, as the sentence says."""

import json
import re
import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.changed_columns import set_values
from support.command_samples import refused
from support.dataset_samples import recorded, same
from support.import_samples import columns_of, map_text, motion, write_log, write_map
from support.lerobot_samples import ARM, RADIANS

import nas_data as nas
from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, TIME, Feature, make_position_feature, make_time_feature
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.dataset.staging import staging_folder
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.write import write
from nas_data.dataset.write_lock import hold_write_lock
from nas_data.errors import BeingWritten, DatasetInvalid, JointMismatch, NasError

SIMULATED = Provenance(how="simulated", robot="arm2", contiguous=True)
WITH_GAP = np.concatenate([np.arange(30), np.arange(30) + 100]) / 50  # [s] 70 frames are missing in the middle


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM)
    return tmp_path


def positions(rows: int = 60) -> np.ndarray:
    """Sines of two joints [rad], shape (rows, 2)."""
    return (0.5 * np.sin(np.arange(rows)[:, None] / 50 * [2.0, 3.0])).astype(np.float32)


def lerobot(
    root: str,
    names: Sequence[str] = ("j1.pos", "j2.pos"),
    asked: Sequence[str] = ("j1.pos", "j2.pos"),
    unit: str = "rad",
    time: np.ndarray | None = None,
) -> Path:
    """A dataset of 60 frames as another tool leaves it: positions, commands and perhaps a clock, no provenance."""
    columns = {STATE: positions(), ACTION: positions() + np.float32(0.01)}
    if unit == "deg":
        columns = {key: np.degrees(column) for key, column in columns.items()}
    units = (unit, unit) if unit else ()
    features = {STATE: Feature(tuple(names), units), ACTION: Feature(tuple(asked), units)}
    if time is not None:
        columns[TIME], features[TIME] = time[:, None], make_time_feature()
    write(Dataset(features, columns, np.array([60]), 50.0, "arm2"), Path(root), SIMULATED)
    Path(root, layout.PROVENANCE).unlink()
    return Path(root)


def commands_in(said: str) -> list[list[str]]:
    """The commands that a sentence names, without `nas`."""
    return [shlex.split(found) for found in re.findall(r"nas (import [^();]+?)(?:\)|;|\.$| divides)", said)]


# What is written


def extra(key: str, width: int = 1, dtype: str = "float32") -> Callable[[Dataset], Dataset]:
    """Return a function that adds a feature."""
    feature = Feature(tuple(f"c{index}" for index in range(width)), dtype=dtype)
    return lambda dataset: dataset.with_column(key, feature, np.ones((dataset.n_frames, width), dtype))


def without(key: str) -> Callable[[Dataset], Dataset]:
    """Return a function that leaves a feature out."""
    return lambda dataset: replace(
        dataset,
        features={name: feature for name, feature in dataset.features.items() if name != key},
        columns={name: column for name, column in dataset.columns.items() if name != key},
    )


def with_nan(dataset: Dataset) -> Dataset:
    return set_values(dataset, ACTION, (7, 1), np.nan)


def with_empty_episode(dataset: Dataset) -> Dataset:
    return replace(dataset, lengths=np.array([5, 0, 7, 5]), tasks=("walk",) * 4)


def unchanged(dataset: Dataset) -> Dataset:
    return dataset


STORED = {
    "an empty episode": (
        with_empty_episode,
        "leave it out, each needs at least one frame",
        lambda d: d.select([0, 2, 3]),
    ),
    "few tasks": (
        lambda d: replace(d, tasks=("walk",)),
        "names 1 task for 3 episodes; give one for each.",
        lambda d: replace(d, tasks=("walk", "walk", "run")),
    ),
    "no rate": (
        lambda d: replace(d, fps=0.0),
        "has a rate of 0.0 Hz; a positive number is needed.",
        lambda d: replace(d, fps=50.0),
    ),
    "LeRobot's column": (
        extra("frame_index"),
        "'frame_index' cannot be stored: LeRobot fills this column by itself; choose another key.",
        lambda d: extra("nas.frame")(without("frame_index")(d)),
    ),
    "a slash": (extra("a/b"), "words without '/'; choose another key.", lambda d: extra("a.b")(without("a/b")(d))),
    "an image": (
        extra("image_sum"),
        "LeRobot takes keys with 'image' for pictures; choose another key.",
        lambda d: extra("brightness")(without("image_sum")(d)),
    ),
    "complex numbers": (
        extra("nas.wave", dtype="complex64"),
        "its dtype is 'complex64'; convert it to numbers or bool.",
        extra("nas.wave"),
    ),
    "no component": (extra("nas.none", 0), "it has no components; leave it out.", without("nas.none")),
    "not a number": (
        with_nan,
        "'action' (m2.pos) is nan in episode 1, frame 2; drop that episode, or repair the data",
        lambda d: d.select([0, 2]),
    ),
    "not a number, repaired": (
        with_nan,
        "or repair the data that it was made from.",
        lambda d: d.with_column(ACTION, d.features[ACTION], np.nan_to_num(d.commands)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STORED)
def test_a_dataset_is_stored_once_it_is_changed_as_is_said(tmp_path, name):
    change, said, mend = STORED[name]
    bad = change(recorded())
    with pytest.raises(DatasetInvalid, match=re.escape(said)):
        write(bad, tmp_path / "d", SIMULATED)
    write(mend(bad), tmp_path / "d", SIMULATED)
    read(tmp_path / "d")


def test_a_column_of_the_shape_that_is_said_is_taken():
    dataset = recorded()
    with pytest.raises(DatasetInvalid, match=re.escape("'nas.load' has shape (17,); 17 frames of 1 are needed.")):
        dataset.with_column("nas.load", Feature(("m1.load",)), np.zeros(17))
    dataset.with_column("nas.load", Feature(("m1.load",)), np.zeros((17, 1)))


def test_the_episodes_and_features_that_are_named_can_be_chosen():
    dataset = recorded()
    with pytest.raises(DatasetInvalid, match=r"There is no episode 3; the dataset has 0 to 2\."):
        dataset.select([3])
    assert dataset.select([0, 2]).n_episodes == 2
    with pytest.raises(JointMismatch, match=re.escape("no feature 'next.observation.sim_state'; it has: ")) as raised:
        _ = dataset.sim_states
    present = str(raised.value).partition("it has: ")[2].rstrip(".").split(", ")
    assert all(len(dataset.columns[key]) == 17 for key in present)


def test_a_recording_of_other_features_grows_under_another_name_as_is_said(tmp_path):
    IncrementalWriter(tmp_path / "d").append(recorded(), SIMULATED)
    other = extra("nas.load")(recorded())
    with pytest.raises(DatasetInvalid, match="another task than the episode to be added; choose another name"):
        IncrementalWriter(tmp_path / "d").append(other, SIMULATED)
    IncrementalWriter(tmp_path / "e").append(other, SIMULATED)
    assert read(tmp_path / "e").n_episodes == 3


def test_a_result_goes_to_another_folder_or_after_removing_one_as_is_said(here, capsys):
    write(recorded(), here / "d", SIMULATED)
    (here / "taken").mkdir()
    assert "taken exists already; choose another folder or remove it." in refused("merge", "d", "--out", "taken")
    assert main(["merge", "d", "--out", "free"]) == 0
    (here / "taken").rmdir()
    assert main(["merge", "d", "--out", "taken"]) == 0


# Arrays in Python

COMMANDED = {"positions": positions(), "commands": positions() + 0.01, "rate": 50, "joints": ["j1", "j2"]}
ARRAYS = {
    "episodes": (
        {"commands": [positions()[:30], positions()[30:]]},
        "The positions are of 1 episode, the commands of 2; give equally many.",
        {"positions": [positions()[:30], positions()[30:]]},
    ),
    "rows": (
        {"commands": positions()[:40]},
        "An episode has 60 rows of positions and 40 of commands; give equally many.",
        {"positions": positions()[:40]},
    ),
    "times": ({"times": np.arange(50) / 50}, "and 50 of times; give equally many.", {"times": np.arange(60) / 50}),
    "kind": ({"kind": "force"}, "kind is 'force'; choose one of: position, velocity, torque.", {"kind": "torque"}),
    "kinds": (
        {"kind": ["torque"]},
        "kind is torque; give one kind, or one for each joint: j1, j2.",
        {"kind": ["torque", "position"]},
    ),
    "joints": ({"joints": ["j1", "j1"]}, "give each joint one name of its own.", {"joints": ["j1", "j2"]}),
    "slides": ({"slides": ["j3"]}, "slides name 'j3', which is no joint; choose among: j1, j2.", {"slides": ["j2"]}),
    "degrees": (
        {"positions": np.degrees(positions()), "commands": np.degrees(positions())},
        "give radians and metres, numpy.radians(positions), or pass turns=True if a joint does turn that far.",
        {"positions": positions(), "commands": positions()},
    ),
    "turns": ({"positions": 40 * positions(), "commands": 40 * positions()}, "or pass turns=True", {"turns": True}),
    "rate": (
        {"times": np.arange(60) / 25},
        "rows come at 25 Hz, but the dataset's rate is 50 Hz; correct 'rate', or the times.",
        {"rate": 25},
    ),
    "clock": (
        {"times": np.arange(60)[::-1] / 50},
        "the time decreases in rows 1–58 (counted from 0); correct the arrays.",
        {"times": np.arange(60) / 50},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_taken_once_they_are_changed_as_is_said(name):
    wrong, said, right = ARRAYS[name]
    with pytest.raises(NasError) as raised:
        nas.Dataset.from_arrays(**COMMANDED | wrong)
    assert said in str(raised.value)
    nas.Dataset.from_arrays(**COMMANDED | wrong | right)


def test_commands_of_the_other_sign_are_reversed_or_of_another_kind_as_is_said(capsys):
    swings = [positions(300), positions(300)]
    made = {"positions": swings, "rate": 50, "joints": ["j1", "j2"]}
    nas.Dataset.from_arrays(commands=[-swing for swing in swings], **made)
    said = capsys.readouterr().err
    assert "reverse the sign of one of them, or give the kind of command: kind='torque' or 'velocity'" in said
    nas.Dataset.from_arrays(commands=swings, **made)
    nas.Dataset.from_arrays(commands=[-swing for swing in swings], kind="torque", **made)
    assert "reverse the sign" not in capsys.readouterr().err


def test_a_dataset_without_joint_names_is_made_with_them_in_python(here):
    shape = {key: Feature(tuple(f"{key}.{index}" for index in range(2))) for key in (STATE, ACTION)}
    swings = [positions(), positions()]
    columns = dict.fromkeys(shape, np.concatenate(swings))
    unnamed = Dataset(shape, columns, np.array([60, 60]), 50.0, "arm2")
    with pytest.raises(JointMismatch, match="have no joint names") as raised:
        nas.pair(unnamed, model="arm.xml")
    assert "joints=names)" in str(raised.value) and "--map" not in str(raised.value)
    named = nas.Dataset.from_arrays(swings, swings, rate=50, joints=["j1", "j2"])
    assert nas.pair(named, model="arm.xml").paired
    features = {STATE: make_position_feature(("j1", "j2")), ACTION: make_position_feature(("a", "b"))}
    with pytest.raises(JointMismatch, match="name the same joints in the features of both") as raised:
        nas.pair(replace(unnamed, features=features), model="arm.xml")
    assert "--map" not in str(raised.value)
    alike = dict.fromkeys(features, features[STATE])
    assert nas.pair(replace(unnamed, features=alike), model="arm.xml").paired


NEXT = make_position_feature(("j1", "other"))
TRANSITIONS = {
    "other joints next": (
        lambda d: d.with_column(NEXT_STATE, NEXT, d.states),
        f"'{NEXT_STATE}' names the joints j1, other; '{STATE}' names j1, j2; name the same in both, or leave "
        f"'{NEXT_STATE}' out.",
        (
            without(NEXT_STATE),
            lambda d: d.with_column(NEXT_STATE, d.features[STATE], np.concatenate([d.states[1:], d.states[-1:]])),
        ),
    ),
    "single frames": (
        lambda d: replace(d, lengths=np.ones(60, int), tasks=("",) * 60),
        "Every episode has a single frame, which makes no transition; record longer episodes.",
        (lambda d: replace(d, lengths=np.full(2, 30), tasks=("",) * 2),),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TRANSITIONS)
def test_transitions_are_made_once_the_dataset_is_changed_as_is_said(name):
    change, said, mends = TRANSITIONS[name]
    features = {key: make_position_feature(("j1", "j2")) for key in (STATE, ACTION)}
    bad = change(Dataset(features, {STATE: positions(), ACTION: positions()}, np.array([60]), 50.0, "arm2"))
    with pytest.raises((DatasetInvalid, JointMismatch), match=re.escape(said)):
        as_transitions(bad)
    for mend in mends:
        as_transitions(mend(bad))


# Datasets of other tools

OWN = RADIANS.replace('unit = "rad"\n', 'unit = "rad"\n{}\n')
UNNAMED = tuple(f"{STATE}.{index}" for index in range(2))
SAME = 'names = ["j1.pos", "j2.pos"]'
OTHER = 'names = ["goal_1", "goal_2"]'
NAMES = {
    "no names": (UNNAMED, tuple(f"{ACTION}.{index}" for index in range(2)), OWN.format("", ""),
                 "have no joint names; import it with a map that gives the joints (nas import --map)."),
    "other names": (("j1.pos", "j2.pos"), ("goal_1", "goal_2"), OWN.format(SAME, OTHER),
                    "commands goal_1, goal_2; name the same joints in both, or name them in a map (nas import --map)."),
}  # fmt: skip


def test_a_dataset_of_single_frames_is_named(here):
    whole = read(lerobot("d"))
    write(replace(whole, lengths=np.ones(60, int), tasks=("",) * 60), here / "short", SIMULATED)
    (here / "short" / layout.PROVENANCE).unlink()
    for command in (("pair", "short", "--model", "arm.xml"), ("import", "short")):
        assert "nas: short: every episode has a single frame" in refused(*command)


@pytest.mark.parametrize("name", NAMES)
def test_joints_are_named_in_a_map_as_is_said(here, name):
    names, asked, text, said = NAMES[name]
    lerobot("d", names, asked)
    Path("own.toml").write_text(text)
    for command in (("pair", "d", "--model", "arm.xml"), ("import", "d")):
        told = refused(*command)
        assert told.startswith("nas: d: ") and told.count("d: ") == 1 and said in told
    assert main(["import", "d", "--map", "own.toml", "--out", "done"]) == 0
    assert main(["pair", "done", "--model", "arm.xml", "--out", "paired"]) == 0


@pytest.mark.parametrize("unit", ["deg", ""])
def test_a_dataset_in_another_unit_is_imported_by_the_command_that_is_named(here, unit):
    """Where no unit is stored, values too large for radians give it away."""
    root = lerobot("d", unit=unit)
    if not unit:
        shutil.rmtree(root)
        features = {key: replace(make_position_feature(("j1", "j2")), units=()) for key in (STATE, ACTION)}
        columns = {key: 300 * positions() for key in features}
        write(Dataset(features, columns, np.array([60]), 50.0, "arm2"), root, SIMULATED)
        (root / layout.PROVENANCE).unlink()
    for use in (["pair", "d", "--model", "arm.xml"], ["import", "d", "--out", "never"]):
        said = refused(*use)
        assert "of joint j1 is in deg, rad is needed" in said if unit else "which cannot be radians (degrees or" in said
        (command,) = commands_in(said)
        assert command == ["import", "d", "--unit", "deg"]
    assert main([*command, "--out", "done"]) == 0


CLOCKS = {
    "rate": (np.arange(60) / 25, "if these times are right, import it at their rate", 2),
    "gap": (WITH_GAP, "nas import d divides the episodes there.", 1),
    "backwards": (np.concatenate([np.arange(30), np.arange(30)]) / 50, "import it and ignore its time stamps", 1),
    "repeated": (np.repeat(np.arange(20), 3) / 17, "ignore", 1),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_that_contradicts_the_rate_is_answered_with_commands_that_import(here, name):
    time, part, count = CLOCKS[name]
    lerobot("d", time=time)
    said = refused("pair", "d", "--model", "arm.xml")
    assert part in said, said
    commands = commands_in(said)
    assert len(commands) == count, said
    for number, command in enumerate(commands):
        assert main([*command, "--out", f"done{number}"]) == 0
        assert main(["pair", f"done{number}", "--model", "arm.xml", "--out", f"paired{number}"]) == 0


def replace_cells(root: Path, key: str, change: Callable[[list], list]) -> None:
    """Change a column of a dataset's only data file."""
    (path,) = layout.list_data_files(root)
    table = pq.read_table(path)
    field = table.schema.field(key)
    column = pa.array(change(table[key].to_pylist()), field.type)
    pq.write_table(table.set_column(table.schema.get_field_index(key), field, column), path)


def test_time_stamps_without_a_number_are_ignored_by_the_command_that_is_named(here):
    root = lerobot("d")
    replace_cells(root, "timestamp", lambda cells: [*cells[:7], float("nan"), *cells[8:]])
    said = refused("import", "d", "--out", "never")
    assert "the time is empty, NaN or infinite in row 7" in said and "ignore its time stamps" in said, said
    (command,) = commands_in(said)
    assert main([*command, "--out", "done"]) == 0


def test_an_episode_that_is_not_finite_is_dropped_by_the_command_that_is_named(here):
    root = write(recorded(), here / "d", SIMULATED)
    replace_cells(root, ACTION, lambda cells: [*cells[:7], [float("inf")] * 3, *cells[8:]])
    said = refused("info", "d")
    assert "'action' (m1.pos) is inf in episode 1, frame 2; drop that episode ('nas recover d --beyond'), or" in said
    assert main(["recover", "d", "--beyond", "--out", "done"]) == 0
    assert read(here / "done").lengths.tolist() == [5, 5]


def test_datasets_of_unlike_features_are_imported_in_the_same_way_to_be_merged(here):
    def import_log(name: str, out: str, **changes: str) -> str:
        write_log(here / f"{name}.npz", columns_of(motion(phase=float(len(name)))))
        write_map(here, map_text(**changes))
        assert main(["import", f"{name}.npz", "--map", "map.toml", "--out", out]) == 0
        return out

    torque = {"command": 'column = "goal"\nunit = "N·m"'}
    first, lean = import_log("a", "first"), import_log("bb", "lean", velocity='"derive"')
    turned = import_log("bb", "turned", **torque)
    alike = import_log("bb", "alike")
    for other, why in ((lean, "first lacks 'nas.velocity', which lean has"), (turned, "'action' has names")):
        said = refused("merge", first, other, "--out", "never")
        assert why in said and "record or import both in the same way to merge them." in said, said
    assert main(["merge", first, alike, "--out", "done"]) == 0


NAMED = {
    "joints": ('["upper", "lower"]', "only datasets of the same joints are merged; if only their names differ, import"),
    "robot": (
        '"other"',
        "only datasets of one robot are merged; if it is the same one, import both with the same 'rob",
    ),
}


@pytest.mark.parametrize("key", NAMED)
def test_datasets_of_one_robot_under_two_names_are_imported_with_one_name_to_be_merged(here, key):
    value, said = NAMED[key]
    text = map_text()
    renamed = re.sub(f"^{key} = .*", f"{key} = {value}", text, flags=re.MULTILINE)
    for name, mapping in (("a", text), ("b", renamed), ("c", text)):
        write_log(here / f"{name}.npz", columns_of(motion(phase=float(ord(name)))))
        write_map(here, mapping)
        assert main(["import", f"{name}.npz", "--map", "map.toml", "--out", name.upper()]) == 0
    assert said in refused("merge", "A", "B", "--out", "never")
    assert main(["merge", "A", "C", "--out", "done"]) == 0


FRONT = "observation.images.front"
VIDEO = f"videos/{FRONT}/chunk-000/file-000.mp4"


def write_video(path: Path, frames: int, size: int = 64) -> None:
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=50)
        stream.width = stream.height = size
        stream.pix_fmt = "yuv420p"
        for number in range(frames):
            picture = np.full((size, size, 3), 4 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def filmed(root: str) -> Path:
    """A recording of three episodes with a camera, killed before LeRobot wrote its table of episodes."""
    folder = write(recorded(), Path(root), SIMULATED)
    entry = {
        "dtype": "video",
        "shape": [64, 64, 3],
        "names": ["height", "width", "channels"],
        "info": {"video.fps": 50},
    }
    info = json.loads((folder / layout.INFO).read_text())
    (folder / layout.INFO).write_text(json.dumps(info | {"features": info["features"] | {FRONT: entry}}))
    write_video(folder / VIDEO, 17)
    shutil.rmtree(folder / "meta/episodes")
    (folder / layout.PROVENANCE).unlink()
    return folder


LOST = {
    "file-000.mp4 is missing": lambda root: (root / VIDEO).unlink(),
    "file-000.mp4 is not a complete video file": lambda root: (root / VIDEO).write_bytes(
        (root / VIDEO).read_bytes()[:-50]
    ),
    "has 9 frames, which do not include all of episode 1": lambda root: write_video(root / VIDEO, 9),
}


@pytest.mark.parametrize("said", LOST)
def test_a_video_that_is_put_back_is_recovered_as_is_said(here, capsys, said):
    root = filmed("d")
    shutil.copytree(root, here / "copy")
    LOST[said](root)
    assert main(["recover", "d", "--out", "blind"]) == 0
    told = capsys.readouterr().out
    assert said in told and "if you have a copy of what is missing or damaged, put it back and recover again" in told
    assert read(here / "blind").passthrough is None
    shutil.copy(here / "copy" / VIDEO, root / VIDEO)
    assert main(["recover", "d", "--out", "seen"]) == 0
    assert FRONT in read(here / "seen").passthrough.features


def test_a_dataset_without_its_videos_is_not_complete_until_they_are_put_back(here, capsys):
    filmed("raw")
    assert main(["recover", "raw", "--out", "d"]) == 0
    shutil.move(here / "d" / VIDEO, here / "copy.mp4")
    capsys.readouterr()
    assert main(["recover", "d", "--out", "blind"]) == 0
    told = capsys.readouterr().out
    assert f"{VIDEO} is missing" in told and "put it back and recover again" in told
    assert "is complete" not in told and "damaged; the metadata" not in told
    assert same(read(here / "blind"), recorded()) and read(here / "blind").passthrough is None
    shutil.move(here / "copy.mp4", here / "d" / VIDEO)
    assert main(["recover", "d", "--out", "whole"]) == 0
    assert "d is complete" in capsys.readouterr().out


def test_a_table_that_is_put_back_gives_the_position_of_the_videos_as_is_said(here, capsys):
    filmed("raw")
    assert main(["recover", "raw", "--out", "d"]) == 0
    (path,) = layout.list_data_files(here / "d")
    pq.write_table(pq.read_table(path).slice(5), path)
    shutil.move(here / "d/meta/episodes", here / "table")
    command = ("recover", "d", "--beyond", "--out")
    capsys.readouterr()
    assert main([*command, "blind"]) == 0
    told = capsys.readouterr().out
    assert (
        "position of its video frames, and earlier rows are lost" in told and "put it back and recover again" in told
    ), told
    shutil.move(here / "table", here / "d/meta/episodes")
    assert main([*command, "seen"]) == 0
    assert FRONT in read(here / "seen").passthrough.features


def test_datasets_are_merged_once_a_camera_is_left_out_as_is_said(here):
    """LeRobot's program takes the camera away; here the same dataset without it stands for its result."""
    filmed("raw")
    assert main(["recover", "raw", "--out", "seen"]) == 0
    for number, root in enumerate(("blind", "other")):
        write(recorded(seed=number), here / root, SIMULATED)
    said = refused("merge", "blind", "seen", "--out", "never")
    program, _, choice = re.search(r"'(lerobot-edit-dataset) (--operation.type)=(\w+)'", said).groups()
    assert main(["merge", "blind", "other", "--out", "done"]) == 0
    lerobot = pytest.importorskip("lerobot")
    script = Path(lerobot.__file__).parent / "scripts" / f"{program.replace('-', '_')}.py"
    if script.exists():  # older ones have no such program
        assert choice in script.read_text()


# Paths at which there is nothing

MISSING = {
    "import none --unit deg": "There is no log none",
    "import d none": "There is no log none",
    "recover none": "nothing to rescue at none: there is no such folder",
    "gap show none": "There is no folder none",
    "policy evaluate none": "There is no folder none",
} | {
    f"{command}": "There is no dataset at none: there is no such folder"
    for command in (
        *("info none", "verify none", "diff d none", "merge d none", "split none --seconds 1", "pack none"),
        *("pair none --model arm.xml", "gap find none --model arm.xml", "recover d --like none"),
    )
}


@pytest.mark.parametrize("command", MISSING)
def test_a_path_at_which_there_is_nothing_is_called_missing(here, command):
    write(recorded(), here / "d", SIMULATED)
    assert MISSING[command] in refused(*command.split())


# What is shared and rescued


def packed(root: str = "d", out: str = "d.nas.tar") -> bytes:
    assert main(["pack", root, "--out", out]) == 0
    return Path(out).read_bytes()


def test_a_pack_goes_where_a_folder_is_as_is_said(here):
    write(recorded(), here / "d", SIMULATED)
    said = refused("pack", "d", "--out", "no/d.nas.tar")
    assert said.endswith("There is no folder no; make it, or give another --out.")
    packed(out="other.nas.tar")
    (here / "no").mkdir()
    packed(out="no/d.nas.tar")


def test_a_file_whose_name_not_every_system_allows_is_renamed_as_is_said(here):
    root = write(recorded(), here / "d", SIMULATED)
    (root / "12:30.txt").write_text("red arm")
    said = refused("pack", "d", "--out", "d.nas.tar")
    assert said.endswith("d/12:30.txt has a name that some file systems do not allow; rename it."), said
    (root / "12:30.txt").rename(root / "12.30.txt")
    packed()


def test_a_pack_that_is_missing_or_damaged_is_given_again_as_is_said(here):
    write(recorded(), here / "d", SIMULATED)
    whole = packed()
    said = refused("unpack", "none.nas.tar")
    assert "There is no file none.nas.tar; give one that 'nas pack' wrote." in said
    Path("d.nas.tar").write_bytes(whole[:-2000])
    assert "copy it again, or have it packed again." in refused("unpack", "d.nas.tar")
    Path("d.nas.tar").unlink()
    packed()
    Path("mine").write_text("a file")
    said = refused("unpack", "d.nas.tar", "--folder", "mine")
    assert said.endswith("mine is a file; give the folder of your datasets with --folder.")
    assert main(["unpack", "d.nas.tar", "--folder", "yours"]) == 0


def test_one_of_several_leftovers_is_rescued_as_is_said(here):
    whole = write(recorded(), here / "d", SIMULATED)
    for number in range(2):
        shutil.copytree(whole, here / f".d.partial-0000000{number}")
    shutil.rmtree(whole)
    said = refused("recover", "d")
    assert "left several unfinished datasets there; give one of: " in said
    one, _ = said.partition("give one of: ")[2].rstrip(".").split(", ")
    assert main(["recover", one, "--out", "done"]) == 0
    assert read(here / "done").n_episodes == 3


def test_what_another_program_writes_is_left_until_it_ends_as_is_said(here):
    whole = write(recorded(), here / "whole", SIMULATED)
    with staging_folder(here / "d") as hidden:
        shutil.copytree(whole, hidden, dirs_exist_ok=True)
        said = refused("recover", str(hidden))
        assert "is being written by a running process; wait until it ends, or end it first." in said
        hidden.rename(here / "d")
    assert main(["recover", "d"]) == 0 and read(here / "d").n_episodes == 3


def test_one_program_at_a_time_writes_under_a_name_as_is_said(here):
    with hold_write_lock(here / "d"):
        with (
            pytest.raises(BeingWritten, match="wait until it ends, or choose another name"),
            hold_write_lock(here / "d"),
        ):
            pass
        with hold_write_lock(here / "e"):
            pass
    with hold_write_lock(here / "d"):
        pass


def test_where_nothing_is_to_be_rescued_a_dataset_is_given_as_is_said(here):
    (here / "empty").mkdir()
    said = refused("recover", "empty")
    assert said.endswith("empty: neither a dataset nor an unfinished one; give a dataset or an unfinished one.")
    root = write(recorded(), here / "d", SIMULATED)
    (root / layout.STATS).write_text("{")
    assert main(["recover", "d", "--out", "done"]) == 0


def spoil(pattern: str, change: Callable[[Path], object]) -> Callable[[Path], None]:
    """Return a function that changes the one file of a dataset that fits a pattern."""

    def damage(root: Path) -> None:
        (path,) = root.glob(pattern)
        change(path)

    return damage


def without_column(path: Path) -> None:
    pq.write_table(pq.read_table(path).drop_columns([ACTION]), path)


def without_numbers(path: Path) -> None:
    pq.write_table(pq.read_table(path).drop_columns(["task_index"]), path)


def with_texts(path: Path) -> None:
    table = pq.read_table(path)
    place = table.schema.get_field_index(TIME)
    pq.write_table(table.set_column(place, TIME, [["soon"] * len(table)]), path)


def with_a_short_list(path: Path) -> None:
    table = pq.read_table(path)
    column = pa.array([[0.0], *table[ACTION].to_pylist()[1:]])
    pq.write_table(table.set_column(table.schema.get_field_index(ACTION), ACTION, column), path)


def edit_info(**changes: object) -> Callable[[Path], object]:
    return lambda path: path.write_text(json.dumps(json.loads(path.read_text()) | changes))


DAMAGES = {
    "no data files (data/*/*.parquet); restore them from a copy": spoil("data/*/*.parquet", Path.unlink),
    "has no column 'action', which": spoil("data/*/*.parquet", without_column),
    "holds string, not numbers as meta/info.json defines": spoil("data/*/*.parquet", with_texts),
    "holds missing values, or lists of another length than 3": spoil("data/*/*.parquet", with_a_short_list),
    "cannot be read as JSON": spoil("meta/info.json", lambda path: path.write_text("{")),
    "does not contain a JSON object": spoil("meta/info.json", lambda path: path.write_text("[]")),
    "lacks a positive fps": spoil("meta/info.json", edit_info(fps=0)),
    "meta/info.json is damaged": spoil("meta/info.json", edit_info(features=3)),
    "tasks.parquet has no tasks that can be read": spoil("meta/tasks.parquet", without_numbers),
    "is not a provenance of nas_data": spoil(layout.PROVENANCE, edit_info(robot=3)),
}


@pytest.mark.parametrize("said", DAMAGES)
def test_a_damaged_file_is_restored_from_a_copy_as_is_said(here, said):
    root = write(recorded(), here / "d", SIMULATED)
    shutil.copytree(root, here / "copy")
    DAMAGES[said](root)
    sentence = refused("pack", "d", "--out", "d.nas.tar")
    assert said in sentence and re.search(r"restore (it|them) from a copy|restore it from a copy, or", sentence), (
        sentence
    )
    shutil.rmtree(root)
    shutil.copytree(here / "copy", root)
    packed()
