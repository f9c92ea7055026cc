"""Hidden files, which systems and tools leave beside data, are nobody's data."""

import shutil
from pathlib import Path

import pytest
from support.dataset_samples import recorded, same
from support.import_samples import JOINTS, columns_of, motion, sample_map, write_log

from nas_data.dataset import layout
from nas_data.dataset.pack import hash_files
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.dataset.write import write
from nas_data.policies.policy import CONFIG, find_policies
from nas_data.recorders.logs import find_logs, import_logs
from nas_data.visible_files import list_visible_files

GHOST = b"\0\5\026\7\0\2\0\0Mac OS X        "  # how a file that macOS keeps for another begins


def leave_ghost(beside: Path) -> None:
    """Leave what macOS leaves beside a file on a foreign disk."""
    beside.with_name(f"._{beside.name}").write_bytes(GHOST)


def leave_checkpoint(beside: Path) -> None:
    """Leave a copy of a file as a notebook server does, in the file's folder and in the one above."""
    for folder in (beside.parent, beside.parent.parent):
        (folder / ".ipynb_checkpoints").mkdir(exist_ok=True)
        shutil.copy(beside, folder / ".ipynb_checkpoints" / f"{beside.stem}-checkpoint{beside.suffix}")


def leave_locks(beside: Path) -> None:
    """Leave what office programs leave beside a file that they have open."""
    for mark in (".~lock.", "~$"):
        beside.with_name(f"{mark}{beside.name}").touch()


LEFT = pytest.mark.parametrize("leave", [leave_ghost, leave_checkpoint, leave_locks])


@LEFT
def test_a_dataset_is_read_without_them(tmp_path, leave):
    dataset = recorded()
    root = write(dataset, tmp_path / "d", Provenance(how="simulated", robot="ergojr"))
    packed = hash_files(root)
    for path in (layout.list_data_files(root)[0], layout.list_episode_files(root)[0], root / layout.INFO):
        leave(path)
    assert same(read(root), dataset)
    assert verify(root) == []
    assert hash_files(root) == packed


@LEFT
@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".json"])
def test_a_folder_of_logs_is_read_without_them(tmp_path, leave, suffix):
    folder = tmp_path / "logs"
    folder.mkdir()
    log = write_log(folder / f"a{suffix}", columns_of(motion()))
    leave(log)
    mapping = sample_map(tmp_path, suffix)
    assert find_logs([folder], mapping) == [log]
    assert import_logs([folder], mapping).dataset.joints == JOINTS


def test_what_is_named_with_its_hidden_folder_is_found(tmp_path):
    policy = tmp_path / ".cache" / "runs" / "seed0"
    policy.mkdir(parents=True)
    (policy / "policy.json").touch()
    assert list_visible_files(tmp_path, "**/*.json") == []
    assert list_visible_files(policy.parent, "*/*.json") == [policy / "policy.json"]


def test_a_backup_of_a_policy_is_no_second_seed(tmp_path):
    for name in ("0", ".ipynb_checkpoints"):
        (tmp_path / name).mkdir()
        (tmp_path / name / CONFIG).touch()
    assert find_policies(tmp_path) == [tmp_path / "0"]
