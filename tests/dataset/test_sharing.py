"""Merging and splitting: laws over any dataset, and every refusal that is promised."""

import hashlib
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.dataset_samples import any_dataset, recorded, same
from support.version_samples import FEW, SIMULATED, original

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.content import hash_content
from nas_data.dataset.derive_provenance import Original
from nas_data.dataset.features import ACTION, SIM_STATE, STATE, Feature
from nas_data.dataset.merge import concatenate, merge
from nas_data.dataset.pack import pack
from nas_data.dataset.provenance import Parent, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.split import draw, format_episodes, parse_episodes, split
from nas_data.dataset.verify import verify
from nas_data.dataset.versions import list_versions
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, JointMismatch, OutputExists


def several(dataset):
    assume(dataset.n_episodes > 1)
    return dataset


@FEW
@given(any_dataset().map(several), st.data())
def test_a_merged_dataset_splits_into_what_it_was_merged_from(dataset, data):
    cut = data.draw(st.integers(1, dataset.n_episodes - 1))
    parts = dataset.select(range(cut)), dataset.select(range(cut, dataset.n_episodes))
    with tempfile.TemporaryDirectory() as home:
        originals = [Original.read(write(part, Path(home) / str(i), SIMULATED)) for i, part in enumerate(parts)]
        merged = merge(originals)
        assert hash_content(merged.dataset) == hash_content(dataset)
        root = write(merged.dataset, Path(home) / "m", merged.provenance, merged.attachments)
        for part, again in zip(parts, split(Original.read(root), range(cut)), strict=True):
            assert hash_content(again.dataset) == hash_content(part)
            assert again.provenance.parents == (Parent("m", hash_content(dataset)),)


@FEW
@given(any_dataset().map(several), st.data())
def test_the_parts_of_a_split_are_disjoint_and_together_complete(dataset, data):
    chosen = data.draw(st.sets(st.integers(0, dataset.n_episodes - 1), min_size=1, max_size=dataset.n_episodes - 1))
    with tempfile.TemporaryDirectory() as home:
        whole = Original.read(write(dataset, Path(home) / "d", SIMULATED))
        first, second = split(whole, list(chosen))
    assert same(first.dataset, dataset.select(sorted(chosen)))
    assert same(second.dataset, dataset.select([i for i in range(dataset.n_episodes) if i not in chosen]))


def test_merging_makes_the_next_version_of_the_first(folder, capsys):
    a, b = original(recorded(), name="arm"), original(recorded(seed=1, lengths=(4, 3)), name="other")
    assert main(["merge", str(a.root), "datasets/other", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    root = Path(answer["dataset"])
    assert root.parent == Path("datasets/arm") and root.name.startswith("v2-")
    assert same(read(root).select([0, 1, 2]), a.dataset) and same(read(root).select([3, 4]), b.dataset)
    provenance = read_provenance(root)
    assert provenance.parents == (a.parent, b.parent)
    assert (provenance.how, provenance.seeds, provenance.signal) == ("edited", (3,), {"name": "steps"})
    assert provenance.contiguous and verify(root) == []
    assert main(["merge", "datasets/arm", "datasets/other", "--name", "both"]) == 0
    assert len(list_versions(Path("datasets/both"))) == 1


def test_what_the_merged_do_not_share_is_left_to_the_parents(folder):
    a = original(recorded(), replace(SIMULATED, source={"name": "x"}, contiguous=True, derived={"s": "one"}))
    b = original(recorded(seed=1), replace(SIMULATED, source={"name": "y"}, contiguous=False, derived={"s": "two"}))
    provenance = merge([a, b]).provenance
    assert provenance.source is None and not provenance.contiguous
    assert provenance.derived == {"s": "one; or two"}


@pytest.mark.parametrize(
    ("second", "kept"),
    [
        ({"meta/source.xml": b"x", "meta/source_effects.json": b"[]"}, {"meta/source.xml", "meta/source_effects.json"}),
        ({"meta/source.xml": b"x", "meta/source_effects.json": b"[1]"}, {"meta/source.xml"}),
        ({"meta/source.xml": b"y"}, set()),
        ({}, set()),
    ],
)
def test_attachments_stay_where_all_have_the_same(folder, second, kept):
    first = {"meta/source.xml": b"x", "meta/source_effects.json": b"[]"}
    a, b = original(recorded(), attachments=first), original(recorded(seed=1), attachments=second)
    assert merge([a, b]).attachments.keys() == kept
    assert all(part.attachments == first for part in split(a, [0]))


def test_an_altered_attachment_is_not_passed_on(folder):
    a = original(recorded(), attachments={"meta/source.xml": b"x"})
    (a.root / "meta/source.xml").write_bytes(b"altered")
    assert Original.read(a.root).attachments == {}


def test_attachments_come_from_inside_the_dataset_whatever_the_provenance_names(folder):
    Path("secret").write_bytes(b"secret")
    a = original(recorded())
    stored = json.loads((a.root / layout.PROVENANCE).read_text())
    digest = hashlib.sha256(b"secret").hexdigest()
    stored["files"]["../../../secret"] = stored["files"]["meta/link"] = digest
    (a.root / layout.PROVENANCE).write_text(json.dumps(stored))
    (a.root / "meta/link").symlink_to(Path("secret").resolve())
    assert Original.read(a.root).attachments == {}


def with_feature(dataset):
    return dataset.with_column("nas.load", Feature(("m1",)), np.zeros((dataset.n_frames, 1), np.float32))


def without_units(dataset):
    return dataset.with_column(ACTION, replace(dataset.features[ACTION], units=()), dataset.commands)


UNLIKE = {
    "has the joints a, b, c, .* has m1, m2, m3": (JointMismatch, lambda d: recorded(joints=("a", "b", "c"))),
    "runs at 40 Hz, .* at 50 Hz": (DatasetInvalid, lambda d: replace(d, fps=40.0)),
    "is of the robot 'so101'": (DatasetInvalid, lambda d: replace(d, robot_type="so101")),
    "lacks 'nas.load'": (DatasetInvalid, with_feature),
    "'action' has units rad in .* and not stored in": (DatasetInvalid, without_units),
}


@pytest.mark.parametrize("message", UNLIKE)
def test_unlike_datasets_are_not_merged(folder, message, capsys):
    kind, change = UNLIKE[message]
    a, b = original(recorded(seed=1)), original(change(recorded()))
    for pair in ([a, b], [b, a]):
        with pytest.raises(kind) as caught:
            merge(pair)
    with pytest.raises(kind, match=message):
        merge([a, b])
    assert "\n" not in str(caught.value)
    before = sorted(folder.rglob("*"))
    assert main(["merge", str(a.root), str(b.root), "--name", "both"]) == 2
    assert sorted(folder.rglob("*")) == before
    assert "Traceback" not in capsys.readouterr().err


def test_a_note_that_several_parents_have_is_kept_once(folder):
    whole = original(recorded(), replace(SIMULATED, notes="rainy"), name="arm")
    parts = [
        original(part.dataset, part.provenance, name=name)
        for part, name in zip(split(whole, [0, 1]), ("first", "second"), strict=True)
    ]
    assert merge(parts).provenance.notes.splitlines() == [
        "rainy",
        f"episodes 0-1 of {whole.parent.name}",
        f"episodes 2 of {whole.parent.name}",
        f"merged from {parts[0].parent.name}, {parts[1].parent.name}",
    ]


def test_a_dataset_that_lost_its_provenance_gets_a_new_one_by_merging(folder, capsys):
    root = write(recorded(), Path("edited_by_lerobot"), SIMULATED)
    (root / layout.PROVENANCE).unlink()
    assert main(["merge", str(root)]) == 0
    assert "has no provenance" in capsys.readouterr().out
    (made,) = list_versions(Path("datasets/edited_by_lerobot"))
    assert read_provenance(made).parents == (Parent("edited_by_lerobot", hash_content(recorded())),)
    assert verify(made) == [] and same(read(made), recorded())


def test_merging_says_what_is_doubtful(folder, capsys):
    paired = recorded().with_column(SIM_STATE, recorded().features[STATE], recorded().next_states)
    a = original(paired, replace(SIMULATED, source={"name": "x"}))
    b = original(paired.select([0]), replace(SIMULATED, source={"name": "y"}))
    assert main(["merge", str(a.root), str(b.root)]) == 0
    text = capsys.readouterr().out
    assert "no single known source" in text and "It holds 1 episode more than once" in text


@pytest.mark.parametrize("first", [0, 1])
def test_predictions_that_a_part_lacks_are_left_out(folder, capsys, first):
    paired = recorded().with_column(SIM_STATE, recorded().features[STATE], recorded().next_states)
    parts = [original(paired, replace(SIMULATED, source={"name": "x"})), original(recorded(seed=1))]
    parts = parts[first:] + parts[:first]
    assert main(["merge", *(str(part.root) for part in parts), "--out", "both"]) == 0
    assert "'next.observation.sim_state' is left out" in capsys.readouterr().out
    assert not read(Path("both")).paired and read_provenance(Path("both")).source is None
    assert read_provenance(Path("both")).parents == tuple(part.parent for part in parts)
    measured = [read(part.root).without_columns({SIM_STATE}) for part in parts]
    assert same(read(Path("both")), concatenate(measured))


@pytest.mark.parametrize(("share", "size"), [(0.8, 8), (0.01, 1), (0.99, 9), (0.5, 5)])
def test_a_share_is_drawn_by_seed(share, size):
    assert draw(10, share, 0) == draw(10, share, 0)
    assert len(draw(10, share, 0)) == size
    assert len({tuple(draw(50, 0.5, seed)) for seed in range(5)}) == 5


@given(st.sets(st.integers(0, 200), min_size=1).map(sorted))
def test_episodes_are_written_as_they_are_read(episodes):
    assert parse_episodes(format_episodes(episodes)) == episodes


def test_splitting_makes_two_datasets_beside_the_first(folder, capsys):
    whole = original(recorded(lengths=(5, 7, 6, 4)), attachments={"meta/source.xml": b"x"}, name="arm")
    assert main(["split", "datasets/arm", "--episodes", "0,2-3", "--json"]) == 0
    parts = json.loads(capsys.readouterr().out)["parts"]
    assert [part["episodes"] for part in parts] == [[0, 2, 3], [1]]
    roots = [Path(part["dataset"]) for part in parts]
    assert [root.parent for root in roots] == [Path("datasets/arm_train"), Path("datasets/arm_test")]
    assert same(read(roots[0]), whole.dataset.select([0, 2, 3])) and same(read(roots[1]), whole.dataset.select([1]))
    assert all((root / "meta/source.xml").read_bytes() == b"x" and verify(root) == [] for root in roots)
    assert read_provenance(roots[1]).parents == (whole.parent,)
    assert f"episodes 0,2-3 of {whole.parent.name}" in read_provenance(roots[0]).notes


def test_splitting_by_share_says_its_seed(folder):
    original(recorded(lengths=(5, 7, 6, 4)), name="arm")
    assert main(["split", "datasets/arm", "--share", "0.5", "--seed", "7", "--names", "left", "right"]) == 0
    (left,), (right,) = (list_versions(Path(f"datasets/{name}")) for name in ("left", "right"))
    assert "a share of 0.5 drawn with seed 7" in read_provenance(left).notes
    assert "the others than a share of 0.5" in read_provenance(right).notes
    assert read(left).n_episodes == read(right).n_episodes == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "to divide the dataset"),
        (["--episodes", "0", "--share", "0.5"], "to divide the dataset"),
        (["--episodes", "0,9"], "no episode 9"),
        (["--episodes", "0,0"], "named twice"),
        (["--episodes", "0-2"], "both parts need"),
        (["--episodes", "2-0"], "is not a range"),
        (["--episodes", "one"], "is not an episode; write"),
        (["--episodes", "0-99999999999"], "is not a range"),
        (["--share", "1.5"], "between 0 and 1"),
        (["--share", "0"], "between 0 and 1"),
        (["--episodes", "0", "--names", "a", "a"], "two names"),
        (["--episodes", "0", "--names", "a", "../b"], "not a valid dataset name"),
    ],
)
def test_a_split_that_is_none_is_refused(folder, options, message, capsys):
    original(recorded(), name="arm")
    before = sorted(folder.rglob("*"))
    assert main(["split", "datasets/arm", *options]) == 2
    assert message in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("command", ["merge", "split", "diff", "pack", "unpack", "recover"])
def test_each_command_explains_itself_with_an_example(command, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    assert f"Example: nas {command}" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["merge", "none"], ["split", "none", "--share", "0.5"], ["pack", "none"]])
def test_a_missing_dataset_is_said_to_be_missing(folder, command, capsys):
    assert main(command) == 2
    assert "There is no dataset at none" in capsys.readouterr().err
    assert not folder.exists()


def test_an_output_that_exists_is_refused(folder):
    a = original(recorded(), name="arm")
    assert main(["merge", str(a.root), "--out", str(a.root)]) == 2
    with pytest.raises(OutputExists):
        pack(a.root, a.root)


def test_single_and_double_precision_of_a_feature_merge_to_double_and_other_dtypes_are_refused(folder):
    def counted(dtype: str, first: int) -> Original:
        dataset = recorded(lengths=(5,))
        column = (first + np.arange(5, dtype=dtype))[:, None]
        return original(dataset.with_column("nas.count", Feature(("count",), dtype=dtype), column), name=dtype)

    single, double, whole = counted("float32", 0), counted("float64", 2**24 + 1), counted("int64", 0)
    for parts in ((single, double), (double, single)):
        merged = merge(parts).dataset
        assert merged.features["nas.count"].dtype == merged.columns["nas.count"].dtype.name == "float64"
        expected = np.concatenate([part.dataset.columns["nas.count"] for part in parts])
        np.testing.assert_array_equal(merged.columns["nas.count"], expected)
        assert merged.features[STATE].dtype == "float32"
    with pytest.raises(DatasetInvalid, match=r"dtype float64 in .* and int64 in "):
        merge((double, whole))
