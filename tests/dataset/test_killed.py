"""What killed writers leave, LeRobot's own and ours, is rescued to the last saved episode."""

import json
import multiprocessing
import shutil
import signal
from pathlib import Path

import pytest
from support.dataset_samples import recorded, same
from support.lerobot_writing import open_dataset, record, resume

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.recover import find_damaged, find_destination
from nas_data.dataset.staging import find_leftovers
from nas_data.dataset.verify import verify
from nas_data.dataset.versions import resolve
from nas_data.errors import DatasetInvalid, NasError, OptionError

SIMULATED = Provenance(how="simulated", robot="ergojr", seeds=(3,), contiguous=True)
EPISODES = recorded(lengths=(20,) * 12)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder in which a user works."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


# Processes to be killed are forked from one that has imported all they need: LeRobot alone takes seconds.
FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(
    ["lerobot.datasets.lerobot_dataset", "support.dataset_samples", "support.lerobot_writing"]
)

BEGIN = "target = create(lerobot_dataset, EPISODES, root)\n"
AGAIN = "target = resume(lerobot_dataset, root)\n"
FINALIZE = "target.finalize()\n"
KILL = "os.kill(os.getpid(), signal.SIGKILL)\n"
EXIT = "os._exit(9)\n"
MIDWAY = (
    "for row in range(5):\n"
    "    target.add_frame({**{key: column[row] for key, column in EPISODES.columns.items()}, 'task': 'walk'})\n"
)


def episodes(first, stop):
    return f"record(target, EPISODES, range({first}, {stop}))\n"


def end_of(code, **names):
    """Return how a process ends that runs lines of Python."""
    process = FORKING.Process(target=exec, args=(code, names), daemon=True)  # what hangs ends with the tests
    process.start()
    process.join(240)
    return process.exitcode


SESSION = """
import os, signal
import datasets.config
from lerobot.datasets import lerobot_dataset
from support.dataset_samples import recorded
from support.lerobot_writing import create, make_durable, record, resume
EPISODES = recorded(lengths=(20,) * 12)
datasets.config.HF_DATASETS_CACHE = root.parent / "cache"
"""


def killed(root, *steps):
    """Record with LeRobot in a process that dies."""
    pytest.importorskip("lerobot")
    assert end_of(SESSION + "".join(steps), root=root) in (-signal.SIGKILL, 9)
    return root


def rescued(root):
    """Rescue by the command and read the result."""
    assert main(["recover", str(root)]) == 0
    return read(Path("datasets") / root.name)


def unchanged(root):
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("count", "end"),
    [pytest.param(12, KILL, marks=pytest.mark.slow), pytest.param(5, EXIT, marks=pytest.mark.slow), (5, MIDWAY + KILL)],
)
def test_every_episode_that_a_killed_lerobot_had_saved_is_rescued(folder, count, end, capsys):
    root = killed(folder / "rec", BEGIN, episodes(0, count), end)
    before = unchanged(root)
    with pytest.raises(DatasetInvalid, match=r"file-000\.parquet is only half-written"):
        read(root)
    assert same(rescued(root), EPISODES.select(range(count)))
    assert "file-000.parquet has no valid Parquet footer" in capsys.readouterr().out
    assert unchanged(root) == before
    made = resolve(Path("datasets/rec"))
    assert verify(made) == []
    assert read_provenance(made).how == "edited" and "rescued from rec" in read_provenance(made).notes


def test_every_episode_of_a_durable_recording_is_rescued(folder):
    steps = [BEGIN, "make_durable(target)\n", episodes(0, 7), MIDWAY, KILL]
    root = killed(folder / "rec", *steps)
    assert same(read(root), EPISODES.select(range(7)))
    assert main(["recover", str(root)]) == 0  # nothing is damaged
    assert not Path("datasets").exists()
    last = sorted((root / "data").rglob("*.parquet"))[-1]
    last.write_bytes(b"PAR1")
    assert same(rescued(root), EPISODES.select(range(6)))


def test_a_first_session_survives_a_second_one_that_was_killed(folder):
    root = killed(folder / "rec", BEGIN, episodes(0, 5), FINALIZE, AGAIN, episodes(5, 12), KILL)
    with pytest.raises(NasError):
        read(root)
    assert same(rescued(root), EPISODES)
    second = sorted((root / "data").rglob("*.parquet"))[1]
    second.write_bytes(bytes(second.stat().st_size))  # after a power cut: the size is there, the pages are not
    shutil.rmtree("datasets")
    assert same(rescued(root), EPISODES.select(range(5)))


def test_what_was_rescued_is_opened_and_continued_by_lerobot(folder, monkeypatch):
    lerobot_dataset = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    import datasets.config

    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", folder / "cache")
    root = killed(folder / "rec", BEGIN, episodes(0, 4), KILL)
    rescued(root)
    made = resolve(Path("datasets/rec"))
    assert len(open_dataset(lerobot_dataset, made)) == 80
    target = resume(lerobot_dataset, made)
    record(target, EPISODES, [4])
    target.finalize()
    assert same(read(made), EPISODES.select(range(5)))


def test_a_recording_whose_pages_never_reached_the_disk_is_said_to_be_lost(folder, capsys):
    root = killed(folder / "rec", BEGIN, episodes(0, 3), KILL)
    (data,) = layout.list_data_files(root)
    for content in (b"", b"PAR1", bytes(data.stat().st_size)):
        data.write_bytes(content)
        before = sorted(folder.rglob("*"))
        assert main(["recover", str(root)]) == 2
        message = capsys.readouterr().err
        assert "Nothing can be rescued" in message and "contains no complete episode" in message
        assert sorted(folder.rglob("*")) == before


def killed_while_writing(folder, part, dataset="recorded()"):
    """Kill our own writer when it is about to write a file."""
    script = (
        "import os, signal\n"
        "os.chdir(folder)\n"
        "from support.dataset_samples import recorded\n"
        "from nas_data.dataset import write as writing, versions\n"
        "from nas_data.dataset.provenance import Provenance\n"
        "put = writing.write_synced\n"
        "def deadly(path, content):\n"
        f"    if {part!r} in str(path): os.kill(os.getpid(), signal.SIGKILL)\n"
        "    put(path, content)\n"
        "writing.write_synced = deadly\n"
        "provenance = Provenance(how='simulated', robot='ergojr')\n"
        f"versions.write_version({dataset}, 'arm', provenance, attachments={{'meta/source.xml': b'x'}})\n"
    )
    assert end_of(script, folder=folder) == -signal.SIGKILL
    (left,) = find_leftovers(folder / "datasets/arm")
    return left


@pytest.mark.parametrize("part", ["meta/episodes", "stats.json", "source.xml", "nas.json", "README.md"])
def test_a_killed_writer_of_ours_leaves_what_can_be_rescued(folder, part, capsys):
    left = killed_while_writing(folder, part)
    before = unchanged(left)
    assert main(["recover", "datasets/arm", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert Path(answer["dataset"]).name.startswith("v1-")
    assert same(read(Path("datasets/arm")), recorded())
    provenance = read_provenance(Path(answer["dataset"]))
    assert provenance.how == ("simulated" if part == "README.md" else "edited")
    assert unchanged(left) == before


def test_a_writer_killed_before_the_rows_leaves_nothing_to_rescue(folder, capsys):
    killed_while_writing(folder, "data/")
    assert main(["recover", "datasets/arm"]) == 2
    assert "it holds no rows" in capsys.readouterr().err


def test_two_leftovers_have_to_be_told_apart(folder):
    first, second = killed_while_writing(folder, "stats"), folder / "datasets/arm/.version.partial-00000000"
    shutil.copytree(first, second)
    with pytest.raises(OptionError, match="give one of"):
        find_damaged(Path("datasets/arm"))
    assert find_damaged(second) == second
    assert find_destination(second) == (folder / "datasets", "arm")
    assert find_destination(folder / f".d{second.name[8:]}") == (Path("datasets"), "d")


def test_what_is_being_written_is_left_alone(folder):
    from nas_data.dataset.staging import staging_folder

    with staging_folder(folder / "d") as hidden, pytest.raises(DatasetInvalid, match="being written"):
        find_damaged(hidden)
