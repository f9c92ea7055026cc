"""A dataset as one file: an uncompressed tar whose bytes depend only on the dataset's files.

The Parquet files are already compressed with Snappy. gzip would save two fifths (44.5 MB to 24.8 MB of 300,000 frames).
But its bytes depend on the zlib version, and it takes longer than everything else. The first member, `nas-pack.json`,
holds the dataset's name, its content hash and the SHA-256 of every other member. Members are sorted and have no owners
or times, so a folder has exactly one pack. The receiver rebuilds and compares it, so that any altered byte is found.
"""

import hashlib
import io
import json
import secrets
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from nas_data.dataset.content import choose_content_hash
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.staging import MARK, flush_folder, refuse_existing
from nas_data.dataset.versions import VERSION, check_name, find_home, resolve
from nas_data.errors import DatasetInvalid, OptionError
from nas_data.visible_files import list_visible_files

SUFFIX = ".nas.tar"
MANIFEST = "nas-pack.json"
SCHEMA = 1
LONGEST_NAME = 200  # characters; the file systems of 2026 end at 255
LONGEST_PATH = 1000  # characters
LARGEST_NUMBER = 10**9  # of a version


@dataclass(frozen=True)
class Manifest:
    """Table of contents of a pack.

    Attributes:
        name: The dataset's name.
        number: Number of its version; 0 if it was not a version.
        content_hash: Its content hash.
        files: SHA-256 of each file by its path in the dataset.
    """

    name: str
    number: int
    content_hash: str
    files: Mapping[str, str]

    def to_bytes(self) -> bytes:
        """Return the stored form; equal values give equal bytes."""
        values = {"schema": SCHEMA, **vars(self), "files": dict(sorted(self.files.items()))}
        return json.dumps(values, indent=1, ensure_ascii=False).encode()

    @classmethod
    def from_bytes(cls, content: bytes) -> "Manifest":
        """Read the stored form.

        Raises:
            ValueError: the content has another form.
        """
        values = json.loads(content)
        if not isinstance(values, dict) or values.pop("schema", None) != SCHEMA:
            raise ValueError(f"its {MANIFEST} is not of schema {SCHEMA}")
        try:
            manifest = cls(**values)
        except TypeError:
            raise ValueError(f"its {MANIFEST} has missing or unexpected entries") from None
        kinds = (manifest.name, str), (manifest.number, int), (manifest.content_hash, str), (manifest.files, dict)
        if not all(isinstance(value, kind) for value, kind in kinds):
            raise ValueError(f"its {MANIFEST} has entries of the wrong kind")
        if len(manifest.name) > LONGEST_NAME or not 0 <= manifest.number <= LARGEST_NUMBER:
            raise ValueError(f"its {MANIFEST} names no dataset")
        check_name(manifest.name)
        return manifest


def pack(path: Path, out: Path | None = None) -> tuple[Path, Manifest]:
    """Write a dataset into one file, atomically.

    Args:
        path: The dataset.
        out: The file; `<name>-<version>.nas.tar` in the current folder otherwise.

    Returns:
        The file and its manifest.

    Raises:
        DatasetNotFound: there is no dataset.
        DatasetInvalid: it is damaged or was changed in place.
        OutputExists: the file exists.
    """
    root = resolve(path)
    _, name = find_home(root)
    version = VERSION.fullmatch(root.resolve().name)
    target = out or Path(f"{name}-{version.group(0)}{SUFFIX}" if version else f"{name}{SUFFIX}")
    refuse_existing(target)
    if not target.parent.is_dir():
        raise OptionError(f"There is no folder {target.parent}; make it, or give another --out.")
    dataset = read(root)
    if dataset.passthrough is not None:
        dataset.passthrough.check(dataset.starts, dataset.lengths)
    provenance = read_provenance(root)
    digest = choose_content_hash(dataset, provenance.content_hash if provenance else "")
    manifest = Manifest(name, int(version.group(1)) if version else 0, digest, hash_files(root))
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


def hash_files(root: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of a dataset by its path, without hidden files.

    Raises:
        DatasetInvalid: there is a link, which another machine could not follow.
    """
    found = {}
    for path in list_visible_files(root, "**/*"):
        name = path.relative_to(root)
        if path.is_symlink():
            raise DatasetInvalid(f"{path} is a link; a pack holds only files: put the file itself there.")
        if not is_plain(name.as_posix()):
            raise DatasetInvalid(f"{path} has a name that some file systems do not allow; rename it.")
        if path.is_file():
            found[name.as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def check_unchanged(root: Path, manifest: Manifest) -> None:
    """Refuse a dataset that differs from its provenance.

    Raises:
        DatasetInvalid: a file is missing or altered, or the content hash differs.
    """
    provenance = read_provenance(root)
    if provenance is None:
        return
    if provenance.content_hash != manifest.content_hash:
        raise DatasetInvalid(
            f"{root} was changed after nas wrote it (its content hash differs from its provenance); "
            "make a new version of it with 'nas merge' and pack that."
        )
    for name, digest in sorted(provenance.files.items()):
        if manifest.files.get(name) != digest:
            what = "was changed after nas wrote it" if name in manifest.files else "is missing"
            raise DatasetInvalid(
                f"{root / name} {what}; restore it from a copy, or rescue the rows with 'nas recover'."
            )


def write_pack(root: Path, manifest: Manifest, out: io.RawIOBase | io.BufferedIOBase) -> None:
    """Write the pack of a folder's files."""
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as archive:
        _add(archive, MANIFEST, manifest.to_bytes())
        for name in sorted(manifest.files):
            _add(archive, name, (root / name).read_bytes())


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    """Add a file without owner and time."""
    member = tarfile.TarInfo(name)
    member.size = len(content)
    archive.addfile(member, io.BytesIO(content))


def is_plain(name: str) -> bool:
    """Whether a path stays inside the target folder, on every system."""
    return len(name) <= LONGEST_PATH and all(
        part and part[0] != "." and part.isprintable() and not set(part) & set('\\:*?"<>|') and len(part.encode()) < 256
        for part in name.split("/")
    )
