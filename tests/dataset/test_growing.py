"""A growing dataset is at every moment a dataset of the episodes that were saved."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.dataset_samples import same, walks

from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.errors import DatasetInvalid, OutputExists

SIMULATED = Provenance(how="hardware", robot="ergojr")
EPISODES = walks()
TESTS = Path(__file__).parents[1]


def grown(root: Path, count: int) -> IncrementalWriter:
    growing = IncrementalWriter(root)
    for number in range(growing.episodes, count):
        growing.append(EPISODES.select([number]), SIMULATED)
    return growing


def test_what_is_saved_is_read(tmp_path):
    for count in range(1, 5):
        assert grown(tmp_path / "rec", count).episodes == count
        assert same(read(tmp_path / "rec"), EPISODES.select(range(count)))
    assert len(list(tmp_path.iterdir())) == 2


def test_several_episodes_are_saved_together(tmp_path, monkeypatch):
    growing = IncrementalWriter(tmp_path / "rec")
    for first, last in ((0, 2), (2, 3), (3, 4), (0, 3)):
        growing.append(EPISODES.select(range(first, last)), SIMULATED)
    whole = EPISODES.select([0, 1, 2, 3, 0, 1, 2])
    assert same(read(tmp_path / "rec"), whole)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    dataset = lerobot.LeRobotDataset("nas/rec", root=tmp_path / "rec")
    assert [int(dataset[frame]["episode_index"]) for frame in whole.starts] == list(range(7))
    assert dataset.meta.episodes["dataset_to_index"] == (whole.starts + whole.lengths).tolist()


def test_lerobot_reads_it_at_every_moment(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    for count in (1, 2, 4):
        grown(tmp_path / "rec", count)
        dataset = lerobot.LeRobotDataset("nas/rec", root=tmp_path / "rec")
        assert dataset.num_episodes == count
        assert len(dataset) == EPISODES.select(range(count)).n_frames
        last = dataset[len(dataset) - 1]
        assert int(last["episode_index"]) == count - 1
        assert np.asarray(last["action"]) == pytest.approx(EPISODES.select(range(count)).commands[-1])


def test_what_a_killed_writer_left_is_removed(tmp_path):
    grown(tmp_path / "rec", 2)
    left = tmp_path / ".rec-000003"
    left.mkdir()
    (left / "half").write_text("written")
    assert grown(tmp_path / "rec", 3).episodes == 3
    assert not (left / "half").exists()
    assert same(read(tmp_path / "rec"), EPISODES.select(range(3)))


def test_names_with_brackets_are_no_patterns(tmp_path):
    grown(tmp_path / "run1.recording", 2)
    grown(tmp_path / "run[1].recording", 3)
    assert IncrementalWriter(tmp_path / "run1.recording").episodes == 2
    assert len(list(tmp_path.iterdir())) == 4


def test_something_else_is_not_touched(tmp_path):
    (tmp_path / "rec").mkdir()
    with pytest.raises(OutputExists):
        IncrementalWriter(tmp_path / "rec")


def test_an_episode_of_other_features_is_refused(tmp_path):
    growing = grown(tmp_path / "rec", 1)
    other = EPISODES.select([1])
    with pytest.raises(DatasetInvalid, match="other features"):
        growing.append(other.with_column("nas.x", other.features["action"], other.columns["action"]), SIMULATED)
    with pytest.raises(DatasetInvalid, match="another task"):
        growing.append(replace(other, tasks=("run",)), SIMULATED)
    assert same(read(tmp_path / "rec"), EPISODES.select([0]))


def test_it_can_be_removed(tmp_path):
    grown(tmp_path / "rec", 2).remove()
    assert list(tmp_path.iterdir()) == []


WRITER = """
import sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from support.dataset_samples import walks
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import Provenance
EPISODES, SIMULATED = walks(), Provenance(how="hardware", robot="ergojr")
growing = IncrementalWriter(Path(sys.argv[1]))
print("ready", flush=True)
while True:
    growing.append(EPISODES.select([growing.episodes % 4]), SIMULATED)
    print(growing.episodes, flush=True)
"""


def test_a_killed_writer_loses_nothing_that_it_called_saved(tmp_path):
    rng = np.random.default_rng(0)
    for _ in range(3):
        command = [sys.executable, "-c", WRITER, str(tmp_path / "rec"), str(TESTS)]
        writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        for _ in range(1 + int(rng.integers(1, 6))):
            said = writer.stdout.readline()
        try:
            rest = writer.communicate(timeout=float(rng.uniform(0, 0.05)))[0]
        except subprocess.TimeoutExpired:
            os.kill(writer.pid, signal.SIGKILL)
            rest = writer.communicate()[0]
        promised = int((said + rest).split()[-1])
        kept = read(tmp_path / "rec")
        assert kept.n_episodes >= promised
        for number in range(kept.n_episodes):
            assert same(kept.select([number]), EPISODES.select([number % 4]))
