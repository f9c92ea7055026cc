"""Packing and unpacking: a law over any dataset, and a refusal of whatever nas did not pack."""

import functools
import hashlib
import io
import json
import os
import shutil
import tarfile
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.dataset_samples import any_dataset, recorded
from support.version_samples import FEW, SIMULATED, original

from nas_data.cli import main
from nas_data.dataset import layout
from nas_data.dataset.content import hash_content
from nas_data.dataset.pack import MANIFEST, SUFFIX, pack
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.unpack import unpack
from nas_data.dataset.verify import verify
from nas_data.dataset.versions import list_versions, write_version
from nas_data.dataset.write import write
from nas_data.errors import DatasetInvalid, DatasetNotFound, OptionError


@FEW
@given(any_dataset())
def test_packing_keeps_content_and_provenance(dataset):
    with tempfile.TemporaryDirectory() as home:
        root = write_version(dataset, "d", SIMULATED, Path(home) / "a", {"meta/source.xml": b"<mujoco/>"})
        file, manifest = pack(root, Path(home) / "d.nas.tar")
        again = unpack(file, Path(home) / "b")
        assert hash_content(read(again)) == hash_content(dataset) == manifest.content_hash
        assert read_provenance(again) == read_provenance(root)
        assert again.name == root.name
        assert {p.relative_to(again): p.read_bytes() for p in again.rglob("*") if p.is_file()} == {
            p.relative_to(root): p.read_bytes() for p in root.rglob("*") if p.is_file()
        }
        assert verify(again) == []


@pytest.fixture
def packed(folder):
    """A pack in the user's folder."""
    return pack(original(recorded(), name="arm", attachments={"meta/source.xml": b"<mujoco/>"}).root)[0]


def test_a_pack_has_the_name_of_its_version_and_is_listed_by_tar(packed):
    (version,) = list_versions(Path("datasets/arm"))
    assert packed == Path(f"arm-{version.name}{SUFFIX}")
    with tarfile.open(packed) as archive:
        members = archive.getmembers()
    assert members[0].name == MANIFEST
    assert {member.name for member in members[1:]} == {
        path.relative_to(version).as_posix() for path in version.rglob("*") if path.is_file()
    }
    assert {(member.mtime, member.uid, member.uname, member.mode) for member in members} == {(0, 0, "", 0o644)}


def test_equal_datasets_have_equal_packs(packed):
    (version,) = list_versions(Path("datasets/arm"))
    copy = Path("elsewhere/arm") / version.name
    shutil.copytree(version, copy)
    for path in copy.rglob("*"):
        os.utime(path, (1, 1))
    (copy / ".DS_Store").write_bytes(b"hidden files do not belong to it")
    again, _ = pack(copy, Path("again.nas.tar"))
    assert again.read_bytes() == packed.read_bytes()


def test_a_pack_is_never_written_over_a_file(packed, capsys):
    content = packed.read_bytes()
    assert main(["pack", "datasets/arm"]) == 2
    assert main(["pack", "datasets/arm", "--out", "no/such/folder/x.nas.tar"]) == 2
    assert packed.read_bytes() == content
    assert "Traceback" not in capsys.readouterr().err
    assert {path.name for path in Path().iterdir()} == {"datasets", packed.name}


def test_unpacking_twice_gives_one_version(packed, capsys):
    assert main(["unpack", str(packed), "--folder", "mine", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["content_hash"] == hash_content(recorded())
    first = Path(answer["dataset"])
    stamp = (first / layout.INFO).stat().st_mtime_ns
    assert unpack(packed, Path("mine")) == first
    assert list_versions(Path("mine/arm")) == [first]
    assert (first / layout.INFO).stat().st_mtime_ns == stamp
    assert unpack(packed, Path("datasets")) == list_versions(Path("datasets/arm"))[0]


def test_a_number_that_is_taken_is_not_given_twice(packed):
    write_version(recorded(seed=9), "arm", SIMULATED, Path("mine"))
    assert unpack(packed, Path("mine")).name == f"v2-{hash_content(recorded())[:8]}"


def test_files_get_the_time_of_their_unpacking(packed):
    root = unpack(packed, Path("mine"))
    assert all(path.stat().st_mtime > 1e9 for path in root.rglob("*"))


def test_a_dataset_without_provenance_is_packed_and_unpacked_once(folder):
    root = write(recorded(), Path("by_lerobot"), SIMULATED)
    (root / layout.PROVENANCE).unlink()
    file, _ = pack(root)
    assert file == Path("by_lerobot.nas.tar")
    assert unpack(file, folder) == unpack(file, folder) == folder / "by_lerobot" / f"v1-{hash_content(recorded())[:8]}"


@functools.cache
def small_pack() -> bytes:
    """Return the bytes of a pack of three rows."""
    with tempfile.TemporaryDirectory() as home:
        root = write_version(recorded(lengths=(3,)), "arm", SIMULATED, Path(home) / "datasets")
        return pack(root, Path(home) / "x.nas.tar")[0].read_bytes()


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_byte_of_a_pack_can_be_altered_unnoticed(data):
    with tempfile.TemporaryDirectory() as home:
        file, content = Path(home) / "x.nas.tar", bytearray(small_pack())
        change = data.draw(st.sampled_from(["flip", "cut", "extend"]))
        place = data.draw(st.integers(0, len(content) - 1))
        if change == "flip":
            content[place] ^= 1 << data.draw(st.integers(0, 7))
        elif change == "cut":
            del content[place:]
        else:
            content += b"\0" * (1 + place % 2000)
        file.write_bytes(content)
        with pytest.raises(DatasetInvalid, match="not a complete pack") as caught:
            unpack(file, Path(home) / "mine")
        assert "\n" not in str(caught.value)
        assert not (Path(home) / "mine").exists()


def repacked(packed, change):
    """Write a pack again with its members changed; its list of files follows."""
    with tarfile.open(packed) as archive:
        members = [(member, archive.extractfile(member).read()) for member in archive]
    members = change(members)
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for member, content in members:
            member.size = len(content) if member.type == tarfile.REGTYPE else 0
            archive.addfile(member, io.BytesIO(content))
    packed.write_bytes(out.getvalue())


def extra(name, kind=tarfile.REGTYPE, link=""):
    member = tarfile.TarInfo(name)
    member.type, member.linkname = kind, link
    return lambda members: [*members, (member, b"bad")]


def rewritten(**changes):
    def change(members):
        (manifest, content), *rest = members
        return [(manifest, json.dumps({**json.loads(content), **changes}, indent=1).encode()), *rest]

    return change


BAD = {
    "'../../evil' in it is not a path": extra("../../evil"),
    "'/evil' in it is not a path": extra("/evil"),
    "'data/../x' in it is not a path": extra("data/../x"),
    "'data//x' in it is not a path": extra("data//x"),
    "'.hidden' in it is not a path": extra(".hidden"),
    r"evil' in it is not a path": extra("..\\evil"),
    "'meta/link' in it is not a regular file": extra("meta/link", tarfile.SYMTYPE, "/etc/passwd"),
    "'meta/hard' in it is not a regular file": extra("meta/hard", tarfile.LNKTYPE, "meta/info.json"),
    "'meta/pipe' in it is not a regular file": extra("meta/pipe", tarfile.FIFOTYPE),
    "'data' in it is not a regular file": extra("data", tarfile.DIRTYPE),
    "'meta/info.json' is in it twice": extra("meta/info.json"),
    "'meta' in it is a file and a folder": extra("meta"),
    "'meta/more.json' is either in it": extra("meta/more.json"),
    "is either in it or in its list": lambda members: members[:-1],
    "it has no nas-pack.json": lambda members: members[1:],
    "not of schema": rewritten(schema=2),
    "missing or unexpected entries": rewritten(more=1),
    "of the wrong kind": rewritten(number="1"),
    "not a valid dataset name": rewritten(name="../up"),
    "names no dataset": rewritten(number=10**30),
    "the content hash of its rows differs": rewritten(content_hash="0" * 64),
    "bytes outside of its files were changed": lambda members: [members[0], *members[:0:-1]],
}


@pytest.mark.parametrize("message", BAD)
def test_a_pack_that_nas_did_not_make_is_refused(packed, message, capsys):
    repacked(packed, BAD[message])
    before = sorted(Path().rglob("*"))
    with pytest.raises(DatasetInvalid, match="not a complete pack") as caught:
        unpack(packed, Path("mine/deep"))
    assert message in str(caught.value)
    assert main(["unpack", str(packed), "--folder", "mine"]) == 2
    said = capsys.readouterr().err
    assert "copy it again, or have it packed again." in said and "Traceback" not in said
    assert sorted(Path().rglob("*")) == before
    packed.unlink()
    pack(Path("datasets/arm"))
    assert unpack(packed, Path("mine")).is_dir()


def test_a_file_replaced_together_with_its_hash_is_found_by_the_content_hash(packed):
    other = write(recorded(seed=8), Path("other"), SIMULATED)
    name = "data/chunk-000/file-000.parquet"
    content = (other / name).read_bytes()

    def change(members):
        manifest = json.loads(members[0][1])
        manifest["files"][name] = hashlib.sha256(content).hexdigest()
        swapped = [(member, content if member.name == name else old) for member, old in members[1:]]
        return [(members[0][0], json.dumps(manifest, indent=1).encode()), *swapped]

    repacked(packed, change)
    with pytest.raises(DatasetInvalid, match="the content hash of its rows differs"):
        unpack(packed, Path("mine"))
    assert not Path("mine").exists()


@pytest.mark.parametrize("content", [b"", b"text", b"\x1f\x8b compressed", b"\0" * 10240])
def test_what_is_no_pack_is_refused(folder, content):
    Path("x.nas.tar").write_bytes(content)
    with pytest.raises(DatasetInvalid, match=r"x\.nas\.tar is not a complete pack"):
        unpack(Path("x.nas.tar"), folder)
    with pytest.raises(DatasetNotFound):
        unpack(Path("none.nas.tar"), folder)
    assert not folder.exists()


def test_a_folder_that_is_a_file_is_refused(packed):
    Path("mine").write_bytes(b"")
    with pytest.raises(OptionError, match="mine is a file"):
        unpack(packed, Path("mine"))


def test_what_was_changed_in_place_is_not_shared(packed, capsys):
    (version,) = list_versions(Path("datasets/arm"))
    (version / "meta/source.xml").write_bytes(b"<other/>")
    with pytest.raises(DatasetInvalid, match=r"source\.xml was changed after nas wrote it"):
        pack(version, Path("x.nas.tar"))
    (version / "meta/source.xml").unlink()
    with pytest.raises(DatasetInvalid, match=r"source\.xml is missing"):
        pack(version, Path("x.nas.tar"))
    (version / "meta/link").symlink_to(Path("/etc/hostname"))
    with pytest.raises(DatasetInvalid, match="is a link"):
        pack(version, Path("x.nas.tar"))
    assert not Path("x.nas.tar").exists()


def test_an_interrupted_pack_leaves_nothing(packed, monkeypatch):
    from nas_data.dataset import pack as packing

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(packing, "write_pack", fail)
    before = sorted(Path().rglob("*"))
    with pytest.raises(KeyboardInterrupt):
        pack(Path("datasets/arm"), Path("x.nas.tar"))
    assert sorted(Path().rglob("*")) == before
