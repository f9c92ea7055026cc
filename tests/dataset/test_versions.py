"""Versions: numbered, named by their content, written once; and the provenance that they carry."""

import json
import multiprocessing
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.dataset_samples import recorded
from support.version_samples import SIMULATED as KNOWN
from support.version_samples import changing_task, write_earlier_version, write_some

from nas_data.cli import main
from nas_data.dataset import versions
from nas_data.dataset.content import hash_content
from nas_data.dataset.derive_provenance import Original
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.pack import pack
from nas_data.dataset.provenance import Parent, Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.summary import summarize, trace_provenance
from nas_data.dataset.unpack import unpack
from nas_data.dataset.versions import find_dataset_name, list_versions, make_parent, resolve, save, write_version
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, DatasetNotFound, OptionError

SIMULATED = Provenance(how="simulated", robot="ergojr")


def test_versions_count_up_and_carry_their_content_hash(tmp_path):
    first = write_version(recorded(seed=0), "arm", SIMULATED, tmp_path)
    second = write_version(recorded(seed=1), "arm", SIMULATED, tmp_path)
    assert first.name == f"v1-{hash_content(recorded(seed=0))[:8]}"
    assert second.name == f"v2-{hash_content(recorded(seed=1))[:8]}"
    assert list_versions(tmp_path / "arm") == [first, second]


def test_the_tenth_version_is_newer_than_the_ninth(tmp_path):
    roots = [write_version(recorded(seed=seed, lengths=(2,)), "arm", SIMULATED, tmp_path) for seed in range(11)]
    assert resolve(tmp_path / "arm") == roots[-1]


def test_equal_content_is_not_written_twice(tmp_path):
    first = write_version(recorded(), "arm", SIMULATED, tmp_path)
    before = (first / PROVENANCE).read_bytes()
    write_version(recorded(seed=1), "arm", SIMULATED, tmp_path)
    again = write_version(recorded(), "arm", Provenance(how="imported", notes="other"), tmp_path)
    assert again == first
    assert (first / PROVENANCE).read_bytes() == before
    assert len(list((tmp_path / "arm").iterdir())) == 2


@pytest.mark.parametrize(
    "target",
    [
        {"registers": [{"from_episode": 0, "joints": {"m1": {"P_Coefficient": 16}}}]},
        {"episodes": [{"log": "a", "constants": {"payload": mass}} for mass in (0.5, 0.5, 0.7)]},
    ],
    ids=["registers", "constants"],
)
def test_equal_rows_of_episodes_with_other_registers_or_constants_are_another_version(tmp_path, target):
    def written(target: dict[str, object]) -> Path:
        return write_version(recorded(), "arm", Provenance(how="imported", target=target), tmp_path)

    plain, described = written({"kind": "log"}), written({"kind": "log", **target})
    assert described != plain and read_provenance(described).target == {"kind": "log", **target}
    assert written({"kind": "log", "settled": 0.3, **target}) == described
    assert written({"kind": "another", "episodes": [{"log": "b", "constants": {}}] * 3}) == plain


def test_an_older_version_that_exists_already_is_told(tmp_path):
    first = write_version(recorded(), "arm", SIMULATED, tmp_path)
    assert versions.describe_older(first) == []
    second = write_version(recorded(seed=1), "arm", SIMULATED, tmp_path)
    again = write_version(recorded(), "arm", SIMULATED, tmp_path)
    (said,) = versions.describe_older(again)
    assert said.startswith(f"{first} exists already") and second.name in said
    assert versions.describe_older(second) == []
    assert versions.describe_older(write(recorded(), tmp_path / "plain", SIMULATED)) == []


def test_processes_that_write_at_once_never_share_a_number(tmp_path):
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=write_some, args=(str(tmp_path), worker)) for worker in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    numbers = sorted(int(root.name[1:].split("-")[0]) for root in list_versions(tmp_path / "arm"))
    assert numbers == list(range(1, 2 * 3 + 2))


def test_a_version_made_from_another_lies_beside_it(tmp_path):
    first = write_version(recorded(), "arm", SIMULATED, tmp_path)
    second = save(recorded(seed=1), SIMULATED, parent=first)
    assert second.parent == first.parent
    assert save(recorded(seed=2), SIMULATED, parent=tmp_path / "arm").name.startswith("v3-")


def test_a_dataset_made_from_a_folder_elsewhere_goes_to_datasets(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parent = write(recorded(), tmp_path / "elsewhere" / "my recording", SIMULATED)
    made = save(recorded(seed=1), SIMULATED, parent=parent)
    assert made.parent == Path("datasets/my_recording")


def test_a_parent_given_from_inside_its_folder_is_found(tmp_path, monkeypatch):
    first = write_version(recorded(), "arm", SIMULATED, tmp_path)
    monkeypatch.chdir(first)
    assert save(recorded(seed=1), SIMULATED, parent=Path()).resolve().parent == first.parent
    monkeypatch.chdir(first.parent)
    assert save(recorded(seed=2), SIMULATED, parent=Path(first.name)).resolve().parent == first.parent


def test_out_is_exactly_the_folder(tmp_path):
    assert save(recorded(), SIMULATED, out=tmp_path / "here", name="arm") == tmp_path / "here"


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden"])
def test_names_that_are_no_folder_are_refused(tmp_path, name):
    with pytest.raises(OptionError, match="not a valid dataset name"):
        write_version(recorded(), name, SIMULATED, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_dataset_is_said_to_have_none(tmp_path):
    with pytest.raises(DatasetNotFound, match="no versions"):
        resolve(tmp_path)


def test_provenance_names_datasets_without_paths(tmp_path):
    root = write_version(recorded(), "arm", SIMULATED, tmp_path)
    parent = make_parent(tmp_path / "arm", read(root))
    assert parent == Parent(f"arm/{root.name}", hash_content(recorded()))
    made = save(recorded(seed=1), Provenance(how="paired", parents=(parent,)), parent=root)
    assert str(tmp_path) not in "".join(path.read_text() for path in made.rglob("*.json"))
    assert find_dataset_name(write(recorded(), tmp_path / "plain", SIMULATED)) == "plain"


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)
objects = st.none() | st.dictionaries(st.text(), json_values, max_size=3)
texts = st.dictionaries(st.text(), st.text(), max_size=3)


@given(
    st.builds(
        Provenance,
        how=st.sampled_from(["simulated", "hardware", "imported", "paired", "edited"]),
        robot=st.text(),
        source=objects,
        target=objects,
        signal=objects,
        seeds=st.lists(st.integers(0, 2**63)).map(tuple),
        parents=st.lists(st.builds(Parent, st.text(), st.text()), max_size=3).map(tuple),
        derived=texts,
        contiguous=st.booleans(),
        notes=st.text(),
        files=texts,
    )
)
def test_provenance_survives_json(provenance):
    stored = json.loads(json.dumps(provenance.to_json()))
    assert Provenance.from_json(stored) == provenance


def test_provenance_names_the_packages():
    assert {"python", "numpy", "pyarrow", "mujoco", "nas_data"} <= SIMULATED.packages.keys()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"schema": 2, "how": "x"}', "update nas_data"),
        ('{"schema": 1}', "not a provenance"),
        ('{"schema": 1, "how": "x", "parents": [{"name": "a"}]}', "not a provenance"),
        ('{"schema": 1, "how": "x", "files": 3}', "not a provenance"),
        ('{"schema": 1, "how": ', "JSON"),
    ],
)
def test_a_damaged_provenance_is_named(tmp_path, content, message):
    root = write(recorded(), tmp_path / "d", SIMULATED)
    (root / PROVENANCE).write_text(content)
    with pytest.raises(DatasetInvalid, match=message) as caught:
        read_provenance(root)
    assert str(root / PROVENANCE) in str(caught.value)


def test_no_provenance_is_none(tmp_path):
    assert read_provenance(tmp_path) is None


def test_version_folders_of_other_names_are_ignored(tmp_path):
    root = write_version(recorded(), "arm", SIMULATED, tmp_path)
    (tmp_path / "arm" / "v9-notahash").mkdir()
    (tmp_path / "arm" / "v9-00000000").mkdir()  # an empty folder is no version, but its number is taken
    assert versions.list_versions(tmp_path / "arm") == [root]
    assert write_version(recorded(seed=1), "arm", SIMULATED, tmp_path).name.startswith("v10-")


def test_a_version_with_the_hash_of_an_earlier_rule_is_unchanged(folder, capsys):
    root = write_earlier_version("walk")
    stored = read_provenance(root).content_hash
    assert stored != hash_content(read(root))
    original = Original.read(root)
    assert list(original.remarks()) == [] and original.parent.content_hash == stored
    assert make_parent(root, read(root)) == original.parent
    assert summarize(root).content_hash == stored
    file, manifest = pack(root)
    assert manifest.content_hash == stored and file.name == f"walk-{root.name}.nas.tar"
    assert unpack(file, Path("elsewhere")).name == root.name
    assert main(["verify", str(root)]) == 0
    assert main(["merge", str(root), "--name", "merged"]) == 0
    assert "was changed" not in capsys.readouterr().out


def test_equal_content_is_not_written_beside_a_version_with_the_hash_of_an_earlier_rule(folder):
    root = write_earlier_version("walk")
    assert write_version(changing_task(), "walk", KNOWN, folder) == root
    assert write_version(changing_task(9), "walk", KNOWN, folder) != root, "its task changes in another frame"


def test_parents_are_found_by_hashes_of_either_rule(folder):
    root = write_earlier_version("walk")
    for digest in (read_provenance(root).content_hash, hash_content(read(root))):
        parent = Parent(f"walk/{root.name}", digest)
        child = write_version(recorded(), f"child-{digest[:4]}", replace(KNOWN, parents=(parent,)), folder)
        assert [name for name, _ in trace_provenance(child)][1:] == [parent.name]
    other = write_version(recorded(), "other", replace(KNOWN, parents=(Parent(parent.name, "0" * 64),)), folder)
    assert len(trace_provenance(other)) == 1
