"""Both ways between us and the installed LeRobot (0.4.4 on Python 3.11, 0.6.1 on 3.12)."""

import os

os.environ["HF_HUB_OFFLINE"] = "1"  # before anything imports huggingface_hub
os.environ["HF_DATASETS_DISABLE_PROGRESS_BARS"] = "1"

import importlib.util
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.dataset_samples import recorded, same
from support.lerobot_writing import create, open_dataset, record, resume

from nas_data.dataset import layout
from nas_data.dataset.content import hash_content
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, TIME, Feature, make_position_feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.verify import verify
from nas_data.dataset.write import write

pytest.importorskip("lerobot")
SIMULATED = Provenance(how="simulated", robot="ergojr")
FRAME_KEYS = (STATE, ACTION, NEXT_STATE, TIME, "next.done")


@pytest.fixture
def lerobot(tmp_path, monkeypatch):
    """LeRobot's dataset module, with its Arrow cache in the test's folder."""
    import datasets.config
    from lerobot.datasets import lerobot_dataset

    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path / "cache")
    return lerobot_dataset


@pytest.fixture
def by_lerobot(lerobot, tmp_path):
    """What LeRobot itself writes of the sample recording."""
    dataset = recorded()
    target = create(lerobot, dataset, tmp_path / "lerobot")
    record(target, dataset, range(3))
    target.finalize()
    return tmp_path / "lerobot"


def test_lerobot_reads_the_values_that_we_wrote(lerobot, tmp_path):
    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    opened = open_dataset(lerobot, root)
    assert (len(opened), opened.num_episodes, opened.fps) == (dataset.n_frames, 3, 50)
    tasks = np.repeat(dataset.tasks, dataset.lengths)
    for row in range(dataset.n_frames):
        item = opened[row]
        assert item["task"] == tasks[row]
        for key, column in dataset.columns.items():
            assert np.array_equal(item[key].numpy().reshape(-1), column[row].astype(item[key].numpy().dtype))


def test_lerobot_loads_windows_and_single_episodes(lerobot, tmp_path):
    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    windows = lerobot.LeRobotDataset(
        "nas/test", root=root, episodes=[1], delta_timestamps={STATE: [-0.02, 0.0]}, video_backend="pyav"
    )
    assert len(windows) == dataset.lengths[1]
    states = dataset.states[dataset.episode(1)]
    assert np.array_equal(windows[3][STATE].numpy(), states[2:4])


def test_we_read_what_lerobot_wrote(by_lerobot):
    assert same(read(by_lerobot), recorded())
    assert hash_content(read(by_lerobot)) == hash_content(recorded())
    assert [problem for problem in verify(by_lerobot) if "nas.json is missing" not in problem] == []


def test_our_metadata_have_the_entries_and_statistics_that_lerobot_writes(by_lerobot, tmp_path):
    ours = write(recorded(), tmp_path / "ours", SIMULATED)
    infos = [json.loads((root / layout.INFO).read_text()) for root in (by_lerobot, ours)]
    assert infos[0] == infos[1]
    theirs, stats = (json.loads((root / layout.STATS).read_text()) for root in (by_lerobot, ours))
    assert theirs.keys() == stats.keys()
    for key in stats:
        assert theirs[key].keys() == stats[key].keys()
        for name in ("min", "max", "mean", "std", "count"):
            assert np.allclose(np.asarray(theirs[key][name], float), stats[key][name], rtol=1e-4, atol=1e-6)


def test_an_episode_appended_by_lerobot_is_read_with_ours(lerobot, tmp_path):
    dataset = recorded(lengths=(5, 7, 6), tasks=("walk", "run", "jump"))
    root = write(dataset.select([0, 1]), tmp_path / "d", SIMULATED)
    target = resume(lerobot, root)
    record(target, dataset, [2])
    target.finalize()
    assert same(read(root), dataset)
    assert len(open_dataset(lerobot, root)) == dataset.n_frames
    problems = " ".join(verify(root))
    assert "file-001.parquet was added" in problems
    assert "content hash" in problems


def test_two_of_our_datasets_are_merged_by_lerobot(lerobot, tmp_path):
    from lerobot.datasets.dataset_tools import merge_datasets

    dataset = recorded(lengths=(5, 7, 6, 4), tasks=("walk", "run", "jump"))
    parts = [write(dataset.select(part), tmp_path / str(part[0]), SIMULATED) for part in ([0, 1], [2, 3])]
    merge_datasets([open_dataset(lerobot, root) for root in parts], "nas/merged", tmp_path / "merged")
    assert same(read(tmp_path / "merged"), dataset)
    assert any("nas.json is missing" in problem for problem in verify(tmp_path / "merged"))


def test_a_merge_of_one_keeps_the_content_hash(lerobot, tmp_path):
    from lerobot.datasets.dataset_tools import merge_datasets

    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    merge_datasets([open_dataset(lerobot, root)], "nas/merged", tmp_path / "merged")
    assert hash_content(read(tmp_path / "merged")) == hash_content(dataset) == read_provenance(root).content_hash


def test_lerobot_deletes_episodes_of_our_datasets(lerobot, tmp_path):
    from lerobot.datasets.dataset_tools import delete_episodes

    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    delete_episodes(open_dataset(lerobot, root), [1], tmp_path / "fewer", "nas/fewer")
    assert same(read(tmp_path / "fewer"), dataset.select([0, 2]))


def test_a_position_only_recording_of_lerobot_is_usable(lerobot, tmp_path):
    names = ("shoulder.pos", "elbow.pos")
    plain = Feature(names)
    rng = np.random.default_rng(1)
    dataset = replace(
        recorded(lengths=(8, 6), joints=("shoulder", "elbow")),
        features={STATE: plain, ACTION: plain},
        columns={key: rng.normal(size=(14, 2)).astype(np.float32) for key in (STATE, ACTION)},
    )
    target = create(lerobot, dataset, tmp_path / "d")
    record(target, dataset, range(2))
    target.finalize()
    usable, derived = as_transitions(read(tmp_path / "d"))
    assert usable.joints == ("shoulder", "elbow")
    assert usable.features[ACTION] == make_position_feature(("shoulder", "elbow"))
    assert usable.lengths.tolist() == [7, 5]
    assert np.array_equal(usable.next_states[:6], usable.states[1:7])
    assert set(derived) == {STATE, NEXT_STATE, ACTION}


def test_images_strings_and_matrices_are_left_out(lerobot, tmp_path):
    features = {
        STATE: {"dtype": "float32", "shape": (2,), "names": ["a.pos", "b.pos"]},
        "note": {"dtype": "string", "shape": (1,), "names": None},
        "observation.images.front": {"dtype": "image", "shape": (8, 8, 3), "names": ["height", "width", "channel"]},
        "grid": {"dtype": "float32", "shape": (2, 2), "names": None},
    }
    target = lerobot.LeRobotDataset.create(
        "nas/test", fps=10, features=features, root=tmp_path / "d", use_videos=False, video_backend="pyav"
    )
    for row in range(4):
        picture = np.full((8, 8, 3), row, np.uint8)
        frame = {STATE: np.array([row, -row], np.float32), "note": "x", "grid": np.eye(2, dtype=np.float32)}
        target.add_frame({**frame, "observation.images.front": picture, "task": "look"})
    target.save_episode()
    target.finalize()
    dataset = read(tmp_path / "d")
    assert list(dataset.features) == [STATE]
    assert dataset.states.tolist() == [[0, 0], [1, -1], [2, -2], [3, -3]]
    left_out = DatasetInfo.read(tmp_path / "d").other_features
    assert set(left_out) == {"note", "observation.images.front", "grid"}


def lerobot_program(name, *arguments, folder):
    """Run one of LeRobot's own programs."""
    program = Path(sys.executable).parent / name
    if not program.exists() and shutil.which(name) is None:
        pytest.skip(f"{name} is not installed")
    environment = {**os.environ, "HF_HOME": str(folder / "hf"), "HF_LEROBOT_HOME": str(folder / "lr")}
    command = [str(program if program.exists() else name), *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=240)


@pytest.mark.slow
def test_lerobot_edit_dataset_describes_our_dataset(tmp_path):
    root = write(recorded(), tmp_path / "d", SIMULATED)
    arguments = ["--repo_id", "nas/test", "--root", str(root), "--operation.type", "info"]
    run = lerobot_program("lerobot-edit-dataset", *arguments, folder=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "17" in run.stdout + run.stderr


@pytest.mark.slow
def test_lerobot_dataset_viz_saves_our_dataset(tmp_path):
    if importlib.util.find_spec("rerun") is None:
        pytest.skip("rerun is not installed (on LeRobot 0.6 it comes with the extra viz)")
    root = write(recorded(), tmp_path / "d", SIMULATED)
    arguments = ["--repo-id", "nas/test", "--root", str(root), "--episode-index", "0", "--save", "1"]
    arguments += ["--output-dir", str(tmp_path), "--num-workers", "0"]
    run = lerobot_program("lerobot-dataset-viz", *arguments, folder=tmp_path)
    assert run.returncode == 0, run.stderr
    assert [path.stat().st_size > 0 for path in tmp_path.glob("*.rrd")] == [True]
