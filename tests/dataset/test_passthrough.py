"""Cameras, depth, messages and tasks of LeRobot's datasets, which nas only passes through.

What LeRobot's own reader returns of a frame is compared exactly. LeRobot 0.4 knows neither depth nor messages: there
the columns themselves are compared.
"""

import json
import shutil
from collections.abc import Callable, Iterable
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.lerobot_samples import annotate, enter_with_arm, motions, speech, write_lerobot

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.language import move_times
from nas_data.dataset.passthrough_source import join_tables
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify

pytest.importorskip("lerobot")
from lerobot.datasets import lerobot_dataset

KNOWS_DEPTH = hasattr(lerobot_dataset.LeRobotDatasetMetadata, "depth_keys")
CHOSEN = (0, 5, 12, 22)  # rows of an episode that are looked at
ROWS = 24  # of an episode; the last one is in no transition
LANGUAGE = ("language_persistent", "language_events")


def said(**arguments: object) -> Callable[[int], list[dict[str, object]]]:
    """Messages of an episode: two subtasks, a question about a picture, and a call with some arguments."""
    return lambda episode: [
        {"role": "assistant", "content": f"reach {episode}", "style": "subtask", "timestamp": 0.0},
        {"role": "assistant", "content": "grasp", "style": "subtask", "timestamp": 0.3},
        {
            "role": "user",
            "content": "where?",
            "style": "vqa",
            "camera": "observation.images.front",
            "timestamp": 0.2,
        },
        speech(0.1, **arguments),
    ]


def degrees(episodes: int = 2) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.degrees(states), np.degrees(commands)) for states, commands in motions(episodes, ROWS)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> tuple[Path, Path]:
    """Two datasets with all there is; in the first, episodes have two tasks, and calls differ."""
    home = tmp_path_factory.mktemp("recorded")
    depth = np.uint16 if KNOWS_DEPTH else None
    tasks = {"a": lambda episode, row: "reach" if row < 12 else f"grasp {episode}", "b": lambda episode, row: "place"}
    made = [write_lerobot(home / name, degrees(), camera=True, depth=depth, task=task) for name, task in tasks.items()]
    annotate(made[0], said(text="hello"))
    annotate(made[1], said(text="hi", voice={"speed": 1.5, "name": "ü"}))
    return made[0], made[1]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    return enter_with_arm(tmp_path, monkeypatch)


def run(*arguments: object) -> None:
    assert main([str(argument) for argument in arguments]) == 0


def imported(root: Path, *options: str) -> Path:
    """Import a dataset in degrees and return the version's folder."""
    name = f"{root.name}_{len(list(Path('datasets').glob('*')))}"
    run("import", root, "--unit", "deg", "--name", name, *options)
    return newest(Path("datasets").resolve() / name)


def newest(home: Path) -> Path:
    return sorted(home.iterdir())[-1]


def plain(value: object) -> object:
    """A value that can be compared with ==: type and numbers of an array, JSON texts as what they hold."""
    if hasattr(value, "numpy"):
        value = value.numpy()
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(json.loads(item) if isinstance(item, str) and item[:1] == "{" else item) for item in value]
    return value


@cache
def all_frames(root: Path) -> dict[int, dict[str, object]]:
    """Everything that is passed through of the chosen frames, by their number."""
    dataset = read(root)
    wanted = [
        start + row
        for start, length in zip(dataset.starts, dataset.lengths, strict=True)
        for row in CHOSEN
        if row < length
    ]
    if KNOWS_DEPTH:
        opened = lerobot_dataset.LeRobotDataset("nas/test", root=root, video_backend="pyav")
        items = [opened[int(row)] for row in wanted]
    else:
        files = [pq.read_table(path) for path in sorted((root / "data").rglob("*.parquet"))]
        rows = [row for file in files for row in file.to_pylist()]
        items = [{**rows[row], "task": dataset.task_of_frame[row]} for row in wanted]
    return {
        row: {key: plain(item[key]) for key in item if is_carried(key)} for row, item in zip(wanted, items, strict=True)
    }


def frames(root: Path, wanted: Iterable[int]) -> list[dict[str, object]]:
    """Everything that is passed through of some of the chosen frames."""
    return [all_frames(root)[int(row)] for row in wanted]


def stored(root: Path, row: int) -> dict[str, object]:
    """A row of the data files as it is stored."""
    table = pa.concat_tables(pq.read_table(path) for path in sorted((root / "data").rglob("*.parquet")))
    return table.slice(row, 1).to_pylist()[0]


def is_carried(key: str) -> bool:
    return key.startswith("observation.images") or key in ("task", "grid", "language", *LANGUAGE)


def all_but_last(episodes: Iterable[int], rows: int = ROWS) -> list[int]:
    """The chosen frames of some episodes that have so many rows."""
    return [episode * rows + row for episode, row in product(episodes, CHOSEN)]


def kept(episodes: Iterable[int]) -> list[int]:
    return all_but_last(episodes, ROWS - 1)


def test_all_that_is_passed_through_survives_every_command(here, recorded):
    a, b = (imported(root) for root in recorded)
    for before, after in zip(recorded, (a, b), strict=True):
        assert frames(after, kept([0, 1])) == frames(before, all_but_last([0, 1]))
    run("merge", a, b, "--name", "both")
    both = newest(here / "datasets/both")
    assert frames(both, kept(range(4))) == frames(a, kept([0, 1])) + frames(b, kept([0, 1]))
    run("split", both, "--episodes", "1,2", "--names", "middle", "ends")
    middle, ends = (newest(here / "datasets" / name) for name in ("middle", "ends"))
    assert frames(middle, kept([0, 1])) == frames(a, kept([1])) + frames(b, kept([0]))
    assert frames(ends, kept([0, 1])) == frames(a, kept([0])) + frames(b, kept([1]))
    run("pack", both, "--out", "both.nas.tar")
    run("unpack", "both.nas.tar", "--folder", "far")
    far = newest(here / "far/both")
    assert frames(far, kept(range(4))) == frames(both, kept(range(4)))
    run("pair", middle, "--model", "arm.xml", "--out", "paired")
    assert frames(here / "paired", kept([0, 1])) == frames(middle, kept([0, 1]))
    for root in (a, both, middle, ends, far, here / "paired"):
        assert verify(root) == []
        info = json.loads((root / "meta/info.json").read_text())
        assert info["tools"][0]["function"]["name"] == "say"
        first = json.loads((recorded[0] / "meta/info.json").read_text())["features"]
        assert {key: info["features"][key] for key in first if is_carried(key)} == {
            key: entry for key, entry in first.items() if is_carried(key)
        }
    for camera in (recorded[0] / "videos").iterdir():
        (original,) = camera.rglob("*.mp4")
        copies = [root / original.relative_to(recorded[0]) for root in (a, both)]
        assert all(copy.samefile(original) for copy in copies)


@pytest.mark.skipif(not KNOWS_DEPTH, reason="LeRobot 0.4 knows no depth")
def test_depth_in_metres_keeps_its_scale_and_is_not_merged_with_millimetres(here, capsys):
    roots = [write_lerobot(here / kind.__name__, degrees(1), depth=kind) for kind in (np.uint16, np.float32)]
    millimetres, metres = (imported(root) for root in roots)
    for root, after in zip(roots, (millimetres, metres), strict=True):
        assert frames(after, kept([0])) == frames(root, all_but_last([0]))
    capsys.readouterr()
    assert main(["merge", str(millimetres), str(metres), "--out", "m"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"has depth_unit m in {metres} and mm in {millimetres}" in error
    assert "use LeRobot's 'lerobot-edit-dataset --operation.type=remove_feature'" in error


def test_episodes_keep_the_task_of_each_frame(here):
    def task(episode: int, row: int) -> str:
        return ("reach", "grasp", "place")[(row + 3 * episode) // 10]

    root = write_lerobot(here / "d", degrees(3), task=task)
    folder = imported(root)
    tasks = [[task(episode, row) for row in range(ROWS - 1)] for episode in range(3)]
    assert read(folder).task_of_frame.tolist() == [text for texts in tasks for text in texts]
    assert read(folder).tasks == ("grasp; place; reach",) * 3 and verify(folder) == []
    cut = imported(root, "--cut", "0.2")
    assert read(cut).tasks == ("reach", "grasp; place", "grasp; reach", "grasp; place", "grasp; reach", "grasp; place")
    assert verify(cut) == []
    table = pa.concat_tables(pq.read_table(path) for path in (cut / "meta/episodes").rglob("*.parquet"))
    assert [sorted(found) for found in table["tasks"].to_pylist()][1] == ["grasp", "place"]


def test_the_times_of_messages_follow_an_episode_that_is_cut(here, recorded):
    """What was true at a frame is still true at it: the last message that began before it."""
    cut = imported(recorded[0], "--cut", "0.2")
    assert read(cut).lengths.tolist() == [10, 13] * 2

    def active(root: Path) -> list[str]:
        table = pa.concat_tables(pq.read_table(path) for path in sorted((root / "data").rglob("*.parquet")))
        rows = zip(table["timestamp"].to_pylist(), table["language_persistent"].to_pylist(), strict=True)
        return [[m["content"] for m in messages if m["timestamp"] <= time + 1e-4][-1] for time, messages in rows]

    assert active(cut) == [what for row, what in enumerate(active(recorded[0])) if row % ROWS != ROWS - 1]
    for episode, row in product((0, 1), CHOSEN):
        event = frames(recorded[0], [episode * ROWS + row])[0]["language_events"]
        assert stored(cut, episode * (ROWS - 1) + row)["language_events"] == event


def test_another_rate_leaves_videos_out_keeps_the_rest_and_says_so(here, recorded, capsys):
    in_radians = write_lerobot(here / "radians", motions(1, ROWS), camera=True)
    annotate(in_radians, said(text="hello"))
    for number, arguments in enumerate(([recorded[0], "--unit", "deg"], [in_radians])):
        out = here / f"{number}"
        capsys.readouterr()
        run("import", *arguments, "--rate", "25", "--uniform", "--out", out)
        told = capsys.readouterr().out
        assert "left out: 'observation.images.front' (video of shape [64, 96, 3])" in told
        assert "because LeRobot finds video frames by the rate" in told
        features = read(out).passthrough.features
        assert "observation.images.front" not in features and {"observation.images.wrist", *LANGUAGE} <= set(features)
        row = stored(out, 20)
        assert row["language"] == "row 20"
        # "grasp" began at row 15, 0.3 s after the start at 50 Hz; that is 0.6 s at 25 Hz
        assert [m["timestamp"] for m in row["language_persistent"]] == pytest.approx([0.0, 0.6])


def test_what_not_every_dataset_has_is_left_out_and_named(here, recorded, capsys):
    Path("map.toml").write_text(MAP)
    bare = write_lerobot(here / "bare", degrees(1))
    run("import", recorded[0], bare, "--map", "map.toml", "--unit", "deg", "--out", "joined")
    told = capsys.readouterr().out
    assert "'language_events' (language of shape [1]), because not every dataset has them" in told
    assert read(here / "joined").passthrough is None and verify(here / "joined") == []


MAP = """format = "lerobot"
robot = "arm2"
joints = ["j1", "j2"]
alignment = "action_follows_state"
velocity = "derive"
[servo]
resolution = 4096
[read.position]
unit = "deg"
[read.command]
unit = "deg"
"""


def drop_columns(path: Path, start: str) -> None:
    table = pq.read_table(path)
    pq.write_table(table.drop_columns([name for name in table.column_names if name.startswith(start)]), path)


@pytest.mark.parametrize(
    ("pattern", "damage", "said_of_it", "key"),
    [
        ("videos/*front/*/*.mp4", Path.unlink, "file-000.mp4 is missing", "observation.images.front"),
        (
            "meta/episodes/*/*.parquet",
            lambda path: drop_columns(path, "videos/observation.images.front/"),
            "meta/episodes does not give the position of the video frames of episode 0",
            "observation.images.front",
        ),
        (
            "data/*/*.parquet",
            lambda path: drop_columns(path, "language_events"),
            "file-000.parquet has no column 'language_events'",
            "language_events",
        ),
    ],
    ids=["video", "place", "column"],
)
def test_what_is_missing_is_named_and_the_remedy_works(here, recorded, capsys, pattern, damage, said_of_it, key):
    shutil.copytree(recorded[0], here / "d")
    (path,) = (here / "d").glob(pattern)
    damage(path)
    capsys.readouterr()
    commands = (
        ["import", "d", "--unit", "deg", "--out", "o"],
        ["merge", "d", "--out", "o"],
        ["split", "d", "--episodes", "0", "--names", "x", "y"],
        ["pack", "d", "--out", "o"],
    )
    for command in commands:
        assert main(command) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and said_of_it in error and f"take '{key}' out of 'features'" in error
        assert not (here / "o").exists()
    assert any(said_of_it in problem for problem in verify(here / "d"))
    info = json.loads((here / "d/meta/info.json").read_text())
    del info["features"][key]
    (here / "d/meta/info.json").write_text(json.dumps(info))
    for command in commands[:-1]:
        run(*command[:-1], f"of_{command[0]}")
    run("pack", "d", "--out", "o")


def test_pictures_count_when_rows_are_divided_into_files(here, recorded, monkeypatch):
    whole = imported(recorded[0])
    monkeypatch.setattr(layout, "FILE_MEGABYTES", 0.005)
    divided = imported(recorded[0])
    assert [len(list((root / "data").rglob("*.parquet"))) for root in (whole, divided)] == [1, 2]
    assert frames(divided, kept([0, 1])) == frames(whole, kept([0, 1])) and verify(divided) == []


def test_the_texts_of_subtasks_stay_with_their_numbers(here, recorded, capsys):
    root = write_lerobot(here / "d", degrees(2))
    (data,) = (root / "data").rglob("*.parquet")
    table = pq.read_table(data)
    number = pa.array([row // 10 for row in table["frame_index"].to_pylist()])
    pq.write_table(table.append_column("subtask_index", number), data)
    info = json.loads((root / "meta/info.json").read_text())
    info["features"]["subtask_index"] = {"dtype": "int64", "shape": [1], "names": None}
    (root / "meta/info.json").write_text(json.dumps(info))
    write_subtasks(root, ["reach", "grasp", "place"])
    folder = imported(root)
    run("merge", folder, folder, "--out", "twice")
    run("split", "twice", "--episodes", "0", "--names", "one", "rest")
    for made in (folder, here / "twice", newest(here / "datasets/rest")):
        assert (made / "meta/subtasks.parquet").read_bytes() == (root / "meta/subtasks.parquet").read_bytes()
        assert stored(made, 22)["subtask_index"] == 2 and verify(made) == []
    write_subtasks(root, ["push"] * 3)
    other = imported(root)
    capsys.readouterr()
    run("merge", folder, other, "--out", "m")
    assert "meta/subtasks.parquet is left out, because it is not the same in all" in capsys.readouterr().out


def write_subtasks(root: Path, subtasks: list[str]) -> None:
    """Write the table that LeRobot 0.4 looks subtasks up in."""
    table = pa.table({"subtask": subtasks, "subtask_index": range(len(subtasks))})
    pq.write_table(table, root / "meta/subtasks.parquet")


def test_equal_rows_with_other_messages_are_another_version(here, recorded):
    shutil.copytree(recorded[0], here / "d")
    for text in ("hello", "hello", "good bye"):
        (data,) = (here / "d/data").rglob("*.parquet")
        table = pq.read_table(data)
        pq.write_table(table.drop_columns(["language"]).append_column("language", pa.array([text] * len(table))), data)
        run("import", "d", "--unit", "deg", "--name", "d")
        run("pack", newest(here / "datasets/d"), "--out", here / f"{len(list(here.glob('*.tar')))}.tar")
        assert len(list((here / "datasets/d").iterdir())) == (2 if text == "good bye" else 1)
    for number in (0, 1, 2):
        run("unpack", f"{number}.tar", "--folder", "far")
    assert len(list((here / "far/d").iterdir())) == 2
    assert (
        read(newest(here / "far/d")).passthrough.columns(0, np.array([3]), 50.0)["language"].to_pylist()
        == ["good bye"] * 3
    )


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**40), 2**40) | st.text(max_size=3),
    lambda inner: st.dictionaries(st.sampled_from("xyz"), inner, min_size=1, max_size=2),
    max_leaves=4,
)


ARGUMENTS = st.dictionaries(st.sampled_from("abc"), VALUES, min_size=1)


def one_message(call: dict[str, object], form: str) -> pa.Table:
    """A table of a message with a call in one of LeRobot's forms: of the annotation, or of the editing tools."""
    calls = pa.array([call if form == "struct" else json.dumps(call)])
    if form == "json":
        calls = pa.ExtensionArray.from_storage(pa.json_(), calls)
    listed = pa.ListArray.from_arrays([0, 1], calls)
    message = pa.StructArray.from_arrays([pa.array(["assistant"]), listed], ["role", "tool_calls"])
    return pa.table({"m": pa.ListArray.from_arrays([0, 1, 1], message)})


@given(st.lists(st.tuples(ARGUMENTS, st.sampled_from(["struct", "text", "json"])), min_size=1, max_size=4))
def test_calls_keep_their_arguments_whatever_others_have(written):
    """Each call is in a file of its own; joined, none has got what it never had."""
    calls = [{"type": "function", "function": {"name": "say", "arguments": found}} for found, _ in written]
    tables = [one_message(call, form) for call, (_, form) in zip(calls, written, strict=True)]
    joined = join_tables(tables)["m"].to_pylist()
    assert [plain(row[0]["tool_calls"]) for row in joined if row] == [plain([call]) for call in calls]


@given(st.lists(st.lists(st.floats(-1, 4, width=32), max_size=3), min_size=1, max_size=5), st.floats(0.1, 2))
def test_times_are_moved_to_the_other_clock(times, shift):
    column = pa.chunked_array([pa.array([[{"timestamp": t, "role": "user"} for t in row] for row in times], KIND)])
    old = np.linspace(0, 3, 31)
    moved = move_times(column, [(old, old - shift)] * len(times)).to_pylist()
    assert [[m["role"] for m in row] for row in moved] == [["user"] * len(row) for row in times]
    np.testing.assert_allclose(
        [m["timestamp"] for row in moved for m in row], [t - shift for row in times for t in row], atol=1e-6
    )


KIND = pa.list_(pa.struct([("role", pa.string()), ("timestamp", pa.float32())]))
