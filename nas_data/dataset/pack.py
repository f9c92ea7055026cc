"""A dataset as one file: an uncompressed tar whose bytes depend on nothing but the dataset's.

Not compressed, because the rows already are (Snappy; gzip takes off a few percent), because gzip's bytes depend on
the zlib that wrote them, and because `tar tf` then lists it at once. The first member, `nas-pack.json`, holds the
dataset's name, its content hash and the SHA-256 of every other member. There is exactly one pack of a folder's files
(sorted, without owners or times), so whoever unpacks can make it again and compare: not one byte can be altered
unnoticed. No time stamps are restored either: `datasets` would take rows of another version with the same time stamp
from its cache.
"""

import hashlib
import io
import json
import secrets
import tarfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from nas_data.dataset import layout
from nas_data.dataset.content import content_hash
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.staging import MARK, flush_folder, put, refuse_existing, staged
from nas_data.dataset.versions import VERSION, check_name, home_of, list_versions, resolve, settle
from nas_data.errors import DatasetInvalid, DatasetNotFound, OptionError, OutputExists

SUFFIX = ".nas.tar"
MANIFEST = "nas-pack.json"
SCHEMA = 1


@dataclass(frozen=True)
class Manifest:
    """What a pack holds.

    Attributes:
        name: The dataset's name.
        number: Number of its version; 0 where it was none.
        content_hash: Its content hash.
        files: SHA-256 of each file by its path in the dataset.
    """

    name: str
    number: int
    content_hash: str
    files: Mapping[str, str]

    def to_bytes(self) -> bytes:
        """Return the stored form, always the same for the same values."""
        values = {"schema": SCHEMA, **vars(self), "files": dict(sorted(self.files.items()))}
        return json.dumps(values, indent=1, ensure_ascii=False).encode()

    @classmethod
    def from_bytes(cls, content: bytes) -> "Manifest":
        """Read the stored form.

        Raises:
            ValueError: not this form.
        """
        values = json.loads(content)
        if not isinstance(values, dict) or values.pop("schema", None) != SCHEMA:
            raise ValueError(f"its {MANIFEST} is not of schema {SCHEMA}")
        try:
            manifest = cls(**values)
        except TypeError:
            raise ValueError(f"its {MANIFEST} has other entries than it should") from None
        strings = isinstance(manifest.files, dict) and all(isinstance(text, str) for text in manifest.files.values())
        if not strings or not isinstance(manifest.number, int) or not isinstance(manifest.name, str):
            raise ValueError(f"its {MANIFEST} has entries of the wrong kind")
        try:
            check_name(manifest.name)
        except OptionError as error:
            raise ValueError(str(error)) from None
        return manifest


def pack(path: Path, out: Path | None = None) -> tuple[Path, Manifest]:
    """Write a dataset into one file, which appears whole or not at all.

    Args:
        path: The dataset.
        out: The file; `<name>-<version>.nas.tar` in the current folder otherwise.

    Returns:
        The file, and what it holds.

    Raises:
        DatasetNotFound, DatasetInvalid: there is no dataset, or it is damaged or was changed in place.
        OutputExists: the file exists.
    """
    root = resolve(path)
    _, name = home_of(root)
    version = VERSION.fullmatch(root.resolve().name)
    target = out or Path(f"{name}-{version.group(0)}{SUFFIX}" if version else f"{name}{SUFFIX}")
    refuse_existing(target)
    if not target.parent.is_dir():
        raise OptionError(f"There is no folder {target.parent}; make it, or give another --out.")
    manifest = Manifest(name, int(version.group(1)) if version else 0, content_hash(read(root)), hashes(root))
    check_unchanged(root, manifest)
    hidden = target.parent / f".{target.name}{MARK}{secrets.token_hex(4)}"
    try:
        with hidden.open("xb") as file:
            write_pack(root, manifest, file)
        refuse_existing(target)
        hidden.rename(target)
    finally:
        hidden.unlink(missing_ok=True)
    flush_folder(target.parent)
    return target, manifest


def hashes(root: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a dataset by its path; hidden files are no part of it.

    Raises:
        DatasetInvalid: a link, which another machine could not follow.
    """
    found = {}
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        if any(part.startswith(".") for part in name.parts):
            continue
        if path.is_symlink():
            raise DatasetInvalid(f"{path} is a link; a pack holds only files: put the file itself there.")
        if path.is_file():
            found[name.as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def check_unchanged(root: Path, manifest: Manifest) -> None:
    """Refuse to share what is not what its provenance says.

    Raises:
        DatasetInvalid: names the first file that is missing or altered, or says that the content was.
    """
    provenance = read_provenance(root)
    if provenance is None:
        return
    if provenance.content_hash != manifest.content_hash:
        raise DatasetInvalid(
            f"{root} was changed after nas wrote it (its content hash differs from its provenance); "
            "make a version of what it is now with 'nas merge' and pack that."
        )
    for name, digest in sorted(provenance.files.items()):
        if manifest.files.get(name) != digest:
            what = "was changed after nas wrote it" if name in manifest.files else "is missing"
            raise DatasetInvalid(f"{root / name} {what}; restore it from a copy, or rescue the rows with 'nas recover'.")


def write_pack(root: Path, manifest: Manifest, out: BinaryIO) -> None:
    """Write the one pack of a folder's files."""
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as archive:
        _add(archive, MANIFEST, manifest.to_bytes())
        for name in sorted(manifest.files):
            _add(archive, name, (root / name).read_bytes())


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    """Add a file without owner and time."""
    member = tarfile.TarInfo(name)
    member.size = len(content)
    archive.addfile(member, io.BytesIO(content))


def unpack(file: Path, folder: Path) -> Path:
    """Take a dataset out of a pack; it appears whole and verified or not at all.

    Args:
        file: The pack.
        folder: The folder of all names, `datasets/`.

    Returns:
        The version's folder; that of the same content where there is one already.

    Raises:
        DatasetNotFound: there is no such file.
        DatasetInvalid: it is no pack, or truncated or altered.
    """
    if not file.is_file():
        raise DatasetNotFound(f"There is no file {file}; give one that 'nas pack' wrote.")
    if folder.exists() and not folder.is_dir():
        raise OutputExists(f"{folder} is a file; give the folder of your datasets.")
    try:
        with tarfile.open(file, mode="r:") as archive:
            members = check_members(archive)
            manifest = Manifest.from_bytes(_content(archive, members.pop(MANIFEST)))
            _check_names(manifest, members)
            home = folder / manifest.name
            new = [path for path in (home, folder) if not path.exists()]
            try:
                with staged(home / "version") as hidden:
                    for name, member in members.items():
                        put(hidden / name, _content(archive, member))
                    _check_whole(file, hidden, manifest)
                    return _settle(hidden, home, manifest)
            finally:
                _remove_empty(new)
    except (tarfile.TarError, EOFError, ValueError, OverflowError) as error:
        raise DatasetInvalid(f"{file} is no whole pack of nas ({error}); ask for it again, or pack it again.") from None


def check_members(archive: tarfile.TarFile) -> dict[str, tarfile.TarInfo]:
    """Return the members of a pack by their path, after none was found that could land elsewhere.

    Raises:
        ValueError: a link, a device, a sparse file, a path that leaves the folder or is no plain path, one twice.
    """
    members: dict[str, tarfile.TarInfo] = {}
    for member in archive:
        if member.type != tarfile.REGTYPE or member.sparse is not None:
            raise ValueError(f"'{member.name}' in it is no plain file")
        if not _is_plain(member.name):
            raise ValueError(f"'{member.name}' in it is no plain path inside a dataset")
        if member.name in members:
            raise ValueError(f"'{member.name}' is in it twice")
        members[member.name] = member
    folders = {parent.as_posix() for name in members for parent in PurePosixPath(name).parents}
    if folders & members.keys():
        raise ValueError(f"'{min(folders & members.keys())}' in it is a file and a folder")
    if MANIFEST not in members:
        raise ValueError(f"it has no {MANIFEST}")
    return members


def _is_plain(name: str) -> bool:
    """Whether a path stays inside the folder that it is put into, on every system."""
    parts = name.split("/")
    return not any(
        not part or part.startswith(".") or set(part) & set('\\:*?"<>|') or not part.isprintable() for part in parts
    ) and all(len(part.encode()) <= 255 for part in parts)


def _content(archive: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    stream = archive.extractfile(member)
    content = stream.read() if stream else b""
    if len(content) != member.size:
        raise ValueError(f"'{member.name}' in it ends early")
    return content


def _check_names(manifest: Manifest, members: Mapping[str, tarfile.TarInfo]) -> None:
    """Refuse a pack that holds other files than it says."""
    different = manifest.files.keys() ^ members.keys()
    if different:
        raise ValueError(f"'{min(different)}' is in its list of files or in the pack, not in both")


def _check_whole(file: Path, hidden: Path, manifest: Manifest) -> None:
    """Compare every file, the rows and the pack itself with what the manifest says.

    Raises:
        ValueError: says what differs.
        DatasetInvalid: the files are no dataset.
    """
    found = hashes(hidden)
    for name, digest in manifest.files.items():
        if found.get(name) != digest:
            raise ValueError(f"'{name}' in it was altered: its SHA-256 differs")
    with file.open("rb") as stream:
        held = hashlib.file_digest(stream, "sha256").hexdigest()
    again = _Digest()
    write_pack(hidden, manifest, again)
    if again.digest.hexdigest() != held:
        raise ValueError("it was altered outside of its files")
    try:
        digest = content_hash(read(hidden))
        check_unchanged(hidden, manifest)
    except (DatasetInvalid, DatasetNotFound) as error:
        raise ValueError(f"it holds no sound dataset: {str(error).replace(f'{hidden}/', '')}") from None
    if digest != manifest.content_hash:
        raise ValueError("its rows have another content hash than it says")


class _Digest(io.RawIOBase):
    """A file that is only hashed."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()
        self.position = 0

    def write(self, content: bytes) -> int:  # type: ignore[override]  # tarfile writes bytes only
        self.digest.update(content)
        self.position += len(content)
        return len(content)

    def tell(self) -> int:
        return self.position


def _settle(hidden: Path, home: Path, manifest: Manifest) -> Path:
    """Make the unpacked folder a version; its number stays where it is free, so that children find it."""
    for path in list_versions(home):
        # A dataset without provenance cannot say its content hash; its rows can.
        same_name = path.name.endswith(manifest.content_hash[:8])
        if same_name and not (path / layout.PROVENANCE).is_file() and content_hash(read(path)) == manifest.content_hash:
            return path
    return settle(hidden, home, manifest.content_hash, manifest.number)


def _remove_empty(folders: Iterator[Path] | list[Path]) -> None:
    """Remove folders that were made for a dataset which was then refused."""
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
