"""Writing and reading: exact for any dataset, in LeRobot's layout, whole or not at all."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from support.changed_columns import set_values
from support.dataset_samples import any_dataset, recorded, same

from nas_data.dataset import layout, staging
from nas_data.dataset import write as writing
from nas_data.dataset.content import hash_content
from nas_data.dataset.features import ACTION, STATE, Feature
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, DatasetNotFound, OutputExists

SIMULATED = Provenance(how="simulated", robot="ergojr")


@settings(max_examples=15, deadline=None)
@given(any_dataset())
def test_what_is_written_is_read_back_to_the_last_bit(dataset):
    with tempfile.TemporaryDirectory() as folder:
        root = write(dataset, Path(folder) / "d", SIMULATED)
        again = read(root)
        assert same(dataset, again)
        assert hash_content(again) == hash_content(dataset) == read_provenance(root).content_hash


def test_episodes_spread_over_many_files_are_read_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(layout, "FILE_MEGABYTES", 1e-4)
    monkeypatch.setattr(layout, "FILES_PER_CHUNK", 3)
    dataset = recorded(lengths=range(1, 12))
    root = write(dataset, tmp_path / "d", SIMULATED)
    assert len({path.parent.name for path in layout.list_data_files(root)}) > 1
    assert len(layout.list_episode_files(root)) > 1
    assert same(dataset, read(root))


def test_rows_of_shuffled_files_are_put_in_the_order_of_their_episodes(tmp_path, monkeypatch):
    monkeypatch.setattr(layout, "FILE_MEGABYTES", 1e-4)
    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    first, *_, last = layout.list_data_files(root)
    swap = tmp_path / "swap"
    first.rename(swap), last.rename(first), swap.rename(last)
    assert same(dataset, read(root))


def test_each_episode_is_one_row_group(tmp_path):
    root = write(recorded(lengths=(4, 4, 9, 2)), tmp_path / "d", SIMULATED)
    metadata = pq.read_metadata(layout.list_data_files(root)[0])
    assert [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)] == [4, 4, 9, 2]


def test_schema_metadata_is_what_hugging_face_datasets_writes(tmp_path):
    datasets = pytest.importorskip("datasets")
    dataset = recorded()
    root = write(dataset, tmp_path / "d", SIMULATED)
    schema = pq.read_schema(layout.list_data_files(root)[0])
    widths = {key: (feature.width, feature.dtype) for key, feature in dataset.features.items()}
    widths |= {key: (1, dtype) for key, dtype in layout.AUTOMATIC.items()}
    features = datasets.Features(
        {
            key: datasets.Value(dtype) if width == 1 else datasets.Sequence(datasets.Value(dtype), length=width)
            for key, (width, dtype) in widths.items()
        }
    )
    assert schema.metadata == features.arrow_schema.metadata


def test_the_same_dataset_gives_the_same_bytes(tmp_path):
    roots = [write(recorded(), tmp_path / name, SIMULATED) for name in "ab"]
    files = [{p.relative_to(r): p.read_bytes() for p in r.rglob("*") if p.is_file()} for r in roots]
    assert files[0] == files[1]


def test_attachments_lie_in_the_dataset_with_their_hash(tmp_path):
    root = write(recorded(), tmp_path / "d", SIMULATED, {"meta/source.xml": b"<mujoco/>"})
    assert (root / "meta/source.xml").read_bytes() == b"<mujoco/>"
    assert "meta/source.xml" in read_provenance(root).files


def test_an_existing_folder_is_never_touched(tmp_path):
    (tmp_path / "d").mkdir()
    with pytest.raises(OutputExists):
        write(recorded(), tmp_path / "d", SIMULATED)
    assert list(tmp_path.rglob("*")) == [tmp_path / "d"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_nothing_is_left_when_writing_fails_midway(tmp_path, monkeypatch, error):
    def fail(*_):
        raise error

    monkeypatch.setattr(writing, "render_card", fail)
    with pytest.raises(error):
        write(recorded(), tmp_path / "d", SIMULATED)
    assert list(tmp_path.iterdir()) == []


def test_a_killed_writer_leaves_only_a_hidden_folder(tmp_path):
    script = (
        "import os, signal, sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from support.dataset_samples import recorded\n"
        "from nas_data.dataset import write as writing\n"
        "from nas_data.dataset.provenance import Provenance\n"
        "writing.render_card = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "writing.write(recorded(), Path(sys.argv[1]) / 'd', Provenance(how='simulated'))\n"
    )
    run = subprocess.run([sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parents[1])], check=False)
    assert run.returncode == -signal.SIGKILL
    assert not (tmp_path / "d").exists()
    assert len(staging.find_leftovers(tmp_path, "d")) == 1


def test_a_folder_being_written_is_no_leftover(tmp_path):
    with staging.staging_folder(tmp_path / "d"):
        assert staging.find_leftovers(tmp_path) == []


@pytest.mark.parametrize("key", ["a/b", "observation.image_state", "frame_index", ""])
def test_keys_that_lerobot_cannot_hold_are_refused(tmp_path, key):
    dataset = recorded()
    bad = dataset.with_column(key, Feature(("x",)), np.zeros((dataset.n_frames, 1), np.float32))
    with pytest.raises(DatasetInvalid, match=f"'{key}'"):
        write(bad, tmp_path / "d", SIMULATED)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_named_by_episode_and_frame(tmp_path, value):
    dataset = set_values(recorded(), ACTION, (5 + 3, 1), value)
    with pytest.raises(DatasetInvalid, match=r"'action' \(m2.pos\).*episode 1, frame 3"):
        write(dataset, tmp_path / "d", SIMULATED)


def test_a_value_too_large_for_its_stored_type_is_refused(tmp_path):
    dataset = recorded()
    large = dataset.with_column(ACTION, dataset.features[ACTION], np.full_like(dataset.commands, 1e39, np.float64))
    with pytest.raises(DatasetInvalid, match="'action'"):
        write(large, tmp_path / "d", SIMULATED)


@pytest.mark.parametrize("lengths", [(), (3, 0, 2)])
def test_empty_episodes_are_refused(tmp_path, lengths):
    dataset = recorded(lengths=(5,)).select([0])
    lengths = np.array(lengths, np.int64)
    columns = {key: column[:1].repeat(lengths.sum(), axis=0) for key, column in dataset.columns.items()}
    empty = replace(dataset, columns=columns, lengths=lengths, tasks=("",) * len(lengths))
    with pytest.raises(DatasetInvalid, match="at least one frame"):
        write(empty, tmp_path / "d", SIMULATED)


def test_a_missing_dataset_is_said_to_be_missing(tmp_path):
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(DatasetNotFound, match=str(path)):
            read(path)


def _info(root, **changes):
    info = json.loads((root / layout.INFO).read_text())
    (root / layout.INFO).write_text(json.dumps({**info, **changes}))


def _truncate(root):
    file = layout.list_data_files(root)[0]
    file.write_bytes(file.read_bytes()[:-100])


def _drop_column(root):
    file = layout.list_data_files(root)[0]
    pq.write_table(pq.read_table(file).drop_columns([ACTION]), file)


def _lose_rows(root):
    file = layout.list_data_files(root)[0]
    pq.write_table(pq.read_table(file).slice(0, 10), file)


def _lose_episode(root):
    file = layout.list_data_files(root)[0]
    table = pq.read_table(file)
    pq.write_table(table.filter(pa.compute.not_equal(table["episode_index"], 1)), file)


def _nan(root):
    file = layout.list_data_files(root)[0]
    table = pq.read_table(file)
    states = np.array(table[STATE].combine_chunks().flatten()).reshape(-1, 6)
    states[6, 2] = np.nan
    column = pa.FixedSizeListArray.from_arrays(pa.array(states.reshape(-1)), 6)
    pq.write_table(table.set_column(table.column_names.index(STATE), STATE, column), file)


def _null(root):
    file = layout.list_data_files(root)[0]
    table = pq.read_table(file)
    column = pa.array([None] * len(table), table.schema.field(ACTION).type)
    pq.write_table(table.set_column(table.column_names.index(ACTION), ACTION, column), file)


DAMAGES = {
    "half-written.*nas recover": _truncate,
    "has no column 'action'": _drop_column,
    "lists 17 frames, the data files contain 10": _lose_rows,
    "no rows of episode 1": _lose_episode,
    r"'observation.state' \(m3.pos\) is nan in episode 1, frame 1": _nan,
    "holds missing values": _null,
    "no data files": lambda root: shutil.rmtree(root / "data"),
    "codebase_version v2.1.*convert": lambda root: _info(root, codebase_version="v2.1"),
    "positive fps": lambda root: _info(root, fps=0),
    "total_frames is 'many', not a whole number": lambda root: _info(root, total_frames="many"),
    "cannot be read as JSON": lambda root: (root / layout.INFO).write_text('{"fps": 5'),
    "tasks.parquet is only half-written": lambda root: (root / layout.TASKS).write_bytes(b"PAR1"),
}


@pytest.mark.parametrize("message", DAMAGES)
def test_damage_is_named(tmp_path, message):
    root = write(recorded(), tmp_path / "d", SIMULATED)
    DAMAGES[message](root)
    with pytest.raises(DatasetInvalid, match=message) as caught:
        read(root)
    assert str(root) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pandas_and_lerobot_are_not_needed_to_read(tmp_path):
    root = write(recorded(), tmp_path / "d", SIMULATED)
    script = (
        "import sys; from pathlib import Path; from nas_data.dataset.read import read; read(Path(sys.argv[1]));"
        "print([name for name in ('lerobot', 'pandas', 'torch', 'datasets', 'scipy') if name in sys.modules])"
    )
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    run = subprocess.run(
        [sys.executable, "-c", script, str(root)], capture_output=True, text=True, check=True, env=environment
    )
    assert run.stdout.strip() == "[]"
