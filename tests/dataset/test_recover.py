"""Recovery of damaged datasets: what is whole comes back, what is not is named."""

import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.dataset_samples import recorded, same

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.content import hash_content
from nas_data.dataset.features import STATE
from nas_data.dataset.provenance import Parent, Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.recover import find_damaged, recover
from nas_data.dataset.verify import verify
from nas_data.dataset.versions import resolve, write_version
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, DatasetNotFound

SIMULATED = Provenance(how="simulated", robot="ergojr", seeds=(3,), contiguous=True)
TESTS = Path(__file__).parents[1]
EPISODES = recorded(lengths=(20,) * 12)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder in which a user works."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def unchanged(root):
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.fixture
def small_files(monkeypatch):
    """Every episode in a file of its own."""
    monkeypatch.setattr(layout, "FILE_MEGABYTES", 1e-9)


@pytest.fixture
def version(folder, small_files):
    """A version of twelve episodes, each in its own file."""
    return write_version(EPISODES, "arm", SIMULATED, attachments={"meta/source.xml": b"x"})


def data_of(root, episode):
    return layout.list_data_files(root)[episode]


def edit_json(path, **changes):
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def rewrite(path, key, change):
    """Rewrite a Parquet file with one column changed."""
    table = pq.read_table(path)
    place = table.column_names.index(key)
    pq.write_table(table.set_column(place, table.schema.field(place), change(table[key])), path)


def _spoil(value):
    def spoil(root):
        def change(column):
            values = np.array(column.combine_chunks().flatten())
            values[8] = value
            return pa.FixedSizeListArray.from_arrays(pa.array(values), 6)

        rewrite(data_of(root, 4), STATE, change)

    return spoil


def _drop_rows(root):
    table = pq.read_table(data_of(root, 4))
    pq.write_table(table.slice(0, 13), data_of(root, 4))


def _drop_column(root):
    pq.write_table(pq.read_table(data_of(root, 4)).drop_columns([STATE]), data_of(root, 4))


LOSSES = {
    "the rows of 1 episode are missing, first those of episode 4": lambda root: data_of(root, 4).unlink(),
    "file-004.parquet has no valid Parquet footer": lambda root: data_of(root, 4).write_bytes(b"PAR1 killed"),
    "episode 4 has values of 'observation.state' that are not finite": _spoil(np.nan),
    "episode 4 has values of 'observation.state' that do not match": _spoil(0.5),
    "episode 4 has 13 frames, but meta/episodes lists 20": _drop_rows,
    "has no column 'observation.state'": _drop_column,
    "episode 4 has missing or repeated frames": lambda root: rewrite(
        data_of(root, 4), "frame_index", lambda column: pa.compute.add(column, 1)
    ),
}


@pytest.mark.parametrize("message", LOSSES)
def test_the_episodes_before_a_lost_one_become_a_new_version(version, message, capsys):
    LOSSES[message](version)
    before = unchanged(version)
    assert main(["recover", str(version), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert any(message in report for report in answer["reports"]), answer["reports"]
    assert (answer["episodes_kept"], answer["episodes_left"]) == ([0, 1, 2, 3], list(range(5, 12)))
    made = Path(answer["dataset"])
    assert made.name.startswith("v2-") and made.parent == Path("datasets/arm")
    assert same(read(made), EPISODES.select(range(4))) and verify(made) == []
    assert (made / "meta/source.xml").read_bytes() == b"x"
    provenance = read_provenance(made)
    assert provenance.parents == (Parent(f"arm/{version.name}", hash_content(EPISODES)),)
    assert (provenance.seeds, provenance.how) == ((3,), "edited")
    assert unchanged(version) == before
    assert main(["recover", str(version), "--beyond", "--name", "all"]) == 0
    assert same(read(Path("datasets/all")), EPISODES.select([0, 1, 2, 3, *range(5, 12)]))


def test_where_the_first_episode_is_lost_the_others_are_offered(version, capsys):
    data_of(version, 0).unlink()
    assert main(["recover", str(version)]) == 2
    assert "11 complete episodes after it can be rescued: add --beyond" in capsys.readouterr().err
    assert main(["recover", str(version), "--beyond"]) == 0
    assert same(read(Path("datasets/arm")), EPISODES.select(range(1, 12)))


def _break(name):
    return lambda root: (root / name).write_bytes(b"PAR1 broken")


METADATA = {
    "tasks": lambda root: (root / layout.TASKS).unlink(),
    "broken tasks": _break(layout.TASKS),
    "episodes": lambda root: shutil.rmtree(root / "meta/episodes"),
    "broken episodes": lambda root: layout.list_episode_files(root)[3].write_bytes(b"PAR1"),
    "stats": _break(layout.STATS),
    "provenance": _break(layout.PROVENANCE),
    "totals": lambda root: edit_json(root / layout.INFO, total_frames=9999, total_episodes=99),
    "null totals": lambda root: edit_json(root / layout.INFO, total_frames=None, total_episodes=None),
    "fewer": lambda root: edit_json(root / layout.INFO, total_frames=20, total_episodes=1),
}


@pytest.mark.parametrize("damage", METADATA)
def test_damaged_metadata_are_made_anew(version, damage):
    METADATA[damage](version)
    before = unchanged(version)
    rescue = recover(find_damaged(version))
    assert same(rescue.derived.dataset, EPISODES)
    assert rescue.reports
    assert main(["recover", str(version)]) == 0
    made = resolve(Path("datasets/arm"))
    assert made.name == f"v2-{hash_content(EPISODES)[:8]}" and verify(made) == []
    assert unchanged(version) == before
    assert main(["recover", str(version)]) == 0
    assert resolve(Path("datasets/arm")) == made  # what was rescued once is not written twice


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_text('{"fps": 5')])
def test_without_info_a_dataset_recorded_alike_is_needed(version, folder, damage, capsys):
    alike = write_version(recorded(seed=7), "alike", SIMULATED)
    damage(version / layout.INFO)
    assert main(["recover", "datasets/arm"]) == 2
    assert "--like DATASET" in capsys.readouterr().err
    assert main(["recover", "datasets/arm", "--like", str(alike)]) == 0
    assert same(read(Path("datasets/arm")), EPISODES)


def test_a_sound_dataset_is_left_as_it_is(version, capsys):
    before = sorted(Path().rglob("*"))
    assert main(["recover", str(version), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["whole"] is True
    assert main(["recover", "datasets/arm"]) == 0
    assert "is complete" in capsys.readouterr().out
    assert sorted(Path().rglob("*")) == before


def test_the_result_lies_where_the_user_says(version, capsys):
    data_of(version, 4).unlink()
    assert main(["recover", str(version), "--out", "here"]) == 0
    assert same(read(Path("here")), EPISODES.select(range(4)))
    before = sorted(Path().rglob("*"))
    assert main(["recover", str(version), "--out", "here"]) == 2
    assert main(["recover", str(version), "--name", "../up"]) == 2
    assert sorted(Path().rglob("*")) == before


def test_an_older_format_is_left_to_its_converter(version):
    edit_json(version / layout.INFO, codebase_version="v2.1")
    with pytest.raises(DatasetInvalid, match="convert"):
        recover(version)


def test_nothing_is_not_rescued(folder, capsys):
    with pytest.raises(DatasetNotFound, match="nothing to rescue"):
        find_damaged(folder / "none")
    assert main(["recover", "none"]) == 2
    assert main(["recover", str(folder)]) == 2
    assert "Traceback" not in capsys.readouterr().err


@settings(max_examples=20, deadline=None)
@given(st.data())
def test_what_is_rescued_is_always_a_prefix_of_what_was_recorded(data):
    """Cut or delete any file: a prefix comes back to the last bit, or a sentence."""
    dataset = recorded(lengths=data.draw(st.lists(st.integers(1, 9), min_size=1, max_size=6)))
    megabytes = layout.FILE_MEGABYTES
    layout.FILE_MEGABYTES = data.draw(st.sampled_from([100, 1e-9, 5e-4]))
    try:
        with tempfile.TemporaryDirectory() as home:
            root = write(dataset, Path(home) / "d", SIMULATED)
            files = sorted(path for path in root.rglob("*") if path.is_file() and path != root / layout.INFO)
            for path in data.draw(st.lists(st.sampled_from(files), min_size=1, max_size=3, unique=True)):
                size = data.draw(st.integers(-1, path.stat().st_size - 1))
                path.unlink() if size < 0 else path.write_bytes(path.read_bytes()[:size])
            try:
                rescue = recover(root)
            except DatasetInvalid as error:
                assert "\n" not in str(error)
                return
            if rescue.derived is None:
                assert same(read(root), dataset)
                return
            found, kept = rescue.derived.dataset, dataset.select(rescue.kept)
            assert rescue.kept == tuple(range(len(rescue.kept)))
            assert same(replace(found, tasks=kept.tasks), kept)
            assert all(task in (true, "") for task, true in zip(found.tasks, kept.tasks, strict=True))
            assert len(kept.lengths) + len(rescue.left) == dataset.n_episodes or rescue.reports
    finally:
        layout.FILE_MEGABYTES = megabytes


@settings(max_examples=20, deadline=None)
@given(st.data())
def test_a_flipped_bit_is_never_passed_over_in_silence(data):
    dataset = recorded(lengths=(6, 4, 5))
    with tempfile.TemporaryDirectory() as home:
        root = write(dataset, Path(home) / "d", SIMULATED)
        files = sorted(path for path in root.rglob("*.parquet"))
        path = data.draw(st.sampled_from([*layout.list_data_files(root), *files]))
        content = bytearray(path.read_bytes())
        content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        path.write_bytes(content)
        try:
            rescue = recover(root)
        except DatasetInvalid as error:
            assert "\n" not in str(error)
            return
        if rescue.derived is None:
            assert verify(root)
            return
        assert path not in layout.list_data_files(root) or any(
            "was changed after nas wrote it" in report for report in rescue.reports
        )
        for place, episode in enumerate(rescue.kept):
            for key, column in rescue.derived.dataset.select([place]).columns.items():
                true = dataset.columns[key][dataset.episode(episode)].astype(float)
                scale = np.abs(true).max(axis=0)
                assert (np.abs(column - true) <= 1e-4 * len(true) * scale + 1e-12).all() or _between(column, true)


def _between(column, true):
    """Whether an altered value lies within the episode's range, with nearly the mean that was recorded."""
    return (column.min(axis=0) >= true.min(axis=0)).all() and (column.max(axis=0) <= true.max(axis=0)).all()
