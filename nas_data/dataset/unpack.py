"""Unpacking of a dataset: it is verified first, then created atomically, and never replaces another.

The files get the time of unpacking. With an older time, `datasets` would read the rows of another version with the same
path and time stamp from its cache.
"""

import hashlib
import io
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from nas_data.dataset.content import has_content_hash
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.pack import MANIFEST, Manifest, check_unchanged, hash_files, is_plain, write_pack
from nas_data.dataset.read import read
from nas_data.dataset.staging import staging_folder, write_synced
from nas_data.dataset.versions import list_versions, settle
from nas_data.errors import DatasetInvalid, DatasetNotFound, NasError, OptionError


def unpack(file: Path, folder: Path) -> Path:
    """Unpack and verify a dataset, atomically.

    Args:
        file: The pack.
        folder: The folder of all datasets, `datasets/`.

    Returns:
        The version's folder; the existing version if one has the same content.

    Raises:
        DatasetNotFound: there is no such file.
        DatasetInvalid: it is not a pack, or it is truncated or altered.
    """
    if not file.is_file():
        raise DatasetNotFound(f"There is no file {file}; give one that 'nas pack' wrote.")
    with _translate_errors(file), tarfile.open(file, mode="r:") as archive:
        manifest = Manifest.from_bytes(_read_content(archive, check_members(archive)[MANIFEST]))
    home = folder / manifest.name
    present = next(path for path in (home, *home.parents) if path.exists())
    if not present.is_dir():
        raise OptionError(f"{present} is a file; give the folder of your datasets with --folder.")
    try:
        with staging_folder(home / "version") as hidden:
            with _translate_errors(file):
                _extract(file, hidden, manifest)
                _check_whole(file, hidden, manifest)
            return _settle(hidden, home, manifest)
    finally:
        _remove_empty(home, present)


@contextmanager
def _translate_errors(file: Path) -> Iterator[None]:
    """Turn errors of reading a pack into one error with the reason."""
    try:
        yield
    except (tarfile.TarError, EOFError, ValueError, LookupError, OverflowError) as error:
        reason = str(error).rstrip(".")
        raise DatasetInvalid(
            f"{file} is not a complete pack of nas ({reason}); copy it again, or have it packed again."
        ) from None


def check_members(archive: tarfile.TarFile) -> dict[str, tarfile.TarInfo]:
    """Return the members of a pack by path, after checking that none would be written outside its folder.

    Raises:
        ValueError: a member is a link, a device or a sparse file, occurs twice, or its path leaves the folder.
    """
    members: dict[str, tarfile.TarInfo] = {}
    for member in archive:
        if member.type != tarfile.REGTYPE or member.sparse is not None:
            raise ValueError(f"{member.name!r} in it is not a regular file")
        if not is_plain(member.name):
            raise ValueError(f"{member.name!r} in it is not a path inside a dataset")
        if member.name in members:
            raise ValueError(f"{member.name!r} is in it twice")
        members[member.name] = member
    folders = {parent.as_posix() for name in members for parent in PurePosixPath(name).parents}
    if folders & members.keys():
        raise ValueError(f"{min(folders & members.keys())!r} in it is a file and a folder")
    if MANIFEST not in members:
        raise ValueError(f"it has no {MANIFEST}")
    return members


def _read_content(archive: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    """Return a member's content; `tarfile` raises an error if it is truncated."""
    stream = archive.extractfile(member)
    return stream.read() if stream else b""


def _extract(file: Path, hidden: Path, manifest: Manifest) -> None:
    """Write the members into a folder; their times and owners are ignored."""
    with tarfile.open(file, mode="r:") as archive:
        members = check_members(archive)
        del members[MANIFEST]
        different = manifest.files.keys() ^ members.keys()
        if different:
            raise ValueError(f"{min(different)!r} is either in it or in its list of files, not in both")
        for name, member in members.items():
            write_synced(hidden / name, _read_content(archive, member))


def _check_whole(file: Path, hidden: Path, manifest: Manifest) -> None:
    """Compare every file, the rows and the pack itself with the manifest; raise ValueError for a difference."""
    found = hash_files(hidden)
    altered = [name for name, digest in manifest.files.items() if found.get(name) != digest]
    if altered:
        raise ValueError(f"{altered[0]!r} in it was changed: its SHA-256 differs")
    with file.open("rb") as stream:
        held = hashlib.file_digest(stream, "sha256").hexdigest()
    if _compute_digest(hidden, manifest) != held:
        raise ValueError("bytes outside of its files were changed")
    try:
        if not has_content_hash(read(hidden), manifest.content_hash):
            raise ValueError("the content hash of its rows differs from the one in it")
        check_unchanged(hidden, manifest)
    except NasError as error:
        reason = str(error).replace(f"{hidden}/", "").rpartition(";")[0]  # the remedy is for the sender
        raise ValueError(f"it contains no valid dataset: {reason}") from None


def _compute_digest(root: Path, manifest: Manifest) -> str:
    """Return the SHA-256 of the pack that a folder's files give."""
    sink = _Digest()
    write_pack(root, manifest, sink)
    return sink.digest.hexdigest()


class _Digest(io.RawIOBase):
    """A file that stores nothing but the hash of its content."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.position = 0

    def write(self, content: object) -> int:
        assert isinstance(content, bytes)
        self.digest.update(content)
        self.position += len(content)
        return len(content)

    def tell(self) -> int:
        return self.position


def _settle(hidden: Path, home: Path, manifest: Manifest) -> Path:
    """Make the unpacked folder a version; it keeps its number if free, so that derived datasets find it."""
    for path in list_versions(home):
        # A dataset without provenance stores no content hash; it is computed from the rows.
        same_name = path.name.endswith(manifest.content_hash[:8])
        if same_name and not (path / PROVENANCE).is_file() and _is_same(path, manifest):
            return path
    return settle(hidden, home, manifest.content_hash, manifest.number)


def _is_same(path: Path, manifest: Manifest) -> bool:
    """Whether a dataset has the rows of a pack, and the same files if it has pass-through features."""
    try:
        carries = DatasetInfo.read(path).other_features
        same = has_content_hash(read(path), manifest.content_hash)
        return same and (not carries or hash_files(path) == manifest.files)
    except NasError:
        return False


def _remove_empty(folder: Path, present: Path) -> None:
    """Remove the folders that were created for a refused dataset."""
    while folder != present and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent
