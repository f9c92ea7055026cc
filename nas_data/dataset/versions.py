"""Versions of datasets: `datasets/<name>/v<N>-<first 8 digits of the content hash>/`, each written once."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from nas_data.dataset.checks import check_storable
from nas_data.dataset.content import choose_content_hash, hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.layout import INFO, SOURCE, SOURCE_EFFECTS
from nas_data.dataset.provenance import Parent, Provenance, read_provenance
from nas_data.dataset.staging import check_creatable, lock_folder, publish, staging_folder
from nas_data.dataset.target_episodes import EPISODES, REGISTERS
from nas_data.dataset.write import encode_json, fill, write
from nas_data.errors import DatasetInvalid, DatasetNotFound, OptionError

FOLDER = Path("datasets")
PASSTHROUGH_FILES = (
    "data/",
    "videos/",
    "meta/episodes/",
    INFO,
)  # where pass-through features and their places are stored
VERSION = re.compile(r"v(\d+)-([0-9a-f]{8})")


def resolve(path: Path) -> Path:
    """Return the folder of a dataset: the path itself, or the newest version below `datasets/<name>`.

    Raises:
        DatasetNotFound: the path is neither a dataset nor a folder of versions.
    """
    if (path / INFO).is_file():
        return path
    found = list_versions(path)
    if found:
        return found[-1]
    if path.is_file():
        raise DatasetNotFound(f"{path} is a file, not a dataset; import it first: nas import {path} --map MAP.toml.")
    reason = f"it has no {INFO} and no versions" if path.is_dir() else "there is no such folder"
    raise DatasetNotFound(f"There is no dataset at {path}: {reason}; give a dataset's folder or datasets/NAME.")


def list_versions(folder: Path) -> list[Path]:
    """Return the versions in a folder, oldest first."""
    if not folder.is_dir():
        return []
    found = [path for path in folder.iterdir() if VERSION.fullmatch(path.name) and (path / INFO).is_file()]
    return sorted(found, key=lambda path: (_number(path), path.name))


def describe_older(root: Path) -> list[str]:
    """Return a sentence if a version that was to be written exists already, and is not the newest of its name."""
    newest = list_versions(root.parent)[-1:] if VERSION.fullmatch(root.name) else []
    if not newest or newest[0].name == root.name:
        return []
    return [
        f"{root} exists already with this content. {root.parent} stands for its newest version, {newest[0].name}: give "
        f"{root} to other commands."
    ]


def find_paired_version(root: Path) -> Path | None:
    """Return the newest paired version in a dataset's folder; `nas pair` writes it there if that is datasets/NAME."""
    paired = [path for path in list_versions(root) if (path / SOURCE).is_file()]
    return paired[-1] if paired else None


def check_paired(root: Path, dataset: Dataset, who: str, otherwise: str = "") -> None:
    """Refuse a dataset without a source's predictions.

    Args:
        root: Folder of the dataset.
        dataset: The dataset.
        who: User of the predictions, for the error.
        otherwise: Another remedy, for the error.

    Raises:
        DatasetInvalid: names the paired version, or the command that makes one.
    """
    if dataset.paired:
        return
    below = find_paired_version(root)
    remedy = f"give its paired version, {below}" if below else f"run `nas pair {root} --model MODEL.xml` first"
    lacking = f"{who} learns from the source's predictions, which {root} lacks"
    raise DatasetInvalid(f"{lacking}: {remedy}{otherwise}.")


def find_dataset_name(path: Path) -> str:
    """Return the name of a dataset in provenance: `name/version` for a version, else its folder's name."""
    root = resolve(path).resolve()
    return f"{root.parent.name}/{root.name}" if VERSION.fullmatch(root.name) else root.name


def make_parent(path: Path, dataset: Dataset) -> Parent:
    """Return the entry of a parent in the provenance of a derived dataset.

    Args:
        path: Folder of the parent.
        dataset: The parent as read, before anything was derived.
    """
    provenance = read_provenance(resolve(path))
    digest = choose_content_hash(dataset, provenance.content_hash if provenance else "")
    return Parent(name=find_dataset_name(path), content_hash=digest)


def write_version(
    dataset: Dataset,
    name: str,
    provenance: Provenance,
    folder: Path = FOLDER,
    attachments: Mapping[str, bytes] | None = None,
    damaged: Path | None = None,
) -> Path:
    """Write a dataset as the next version of its name, unless a version with the same content and origin exists.

    What rows do not hold counts, too: the source, and the servos' registers and the log's constants of each episode.

    Args:
        dataset: The dataset.
        name: Its name.
        provenance: Its provenance.
        folder: The folder of all datasets.
        attachments: Further files by their path in the dataset.
        damaged: A version not to return, although it claims the same content.

    Returns:
        The version's folder, or the existing one.

    Raises:
        OptionError: the name is not a valid folder name.
        DatasetInvalid: LeRobot's tools could not read this dataset.
    """
    check_name(name)
    check_storable(dataset, "The dataset to be written")
    digest, earlier = hash_content(dataset), ""
    if dataset.frame_tasks is not None:
        earlier = hash_content(dataset, frame_tasks=False)
    home = folder / name
    written = {name: hashlib.sha256(content).hexdigest() for name, content in (attachments or {}).items()}
    complete = replace(provenance, content_hash=digest, files=written)
    existing = None
    if dataset.passthrough is None:
        existing = _find_same_version(home, digest, complete, damaged, earlier=earlier)
    if existing:
        return existing
    with staging_folder(home / "version") as hidden:
        fill(hidden, dataset, complete, attachments or {})
        return settle(hidden, home, digest, damaged=damaged, earlier=earlier)


def check_name(name: str) -> None:
    """Raise OptionError if a name is not a valid folder name."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        raise OptionError(f"'{name}' is not a valid dataset name; use letters, digits, '.', '_' and '-'.")


def make_name(text: str) -> str:
    """Return a valid dataset name for a text: other characters become `_`."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", text).lstrip("._-") or "dataset"


def settle(
    hidden: Path, home: Path, digest: str, number: int = 0, damaged: Path | None = None, earlier: str = ""
) -> Path:
    """Make a staged folder a version, unless one with its content and source exists.

    Args:
        hidden: The complete folder.
        home: Folder of the name's versions.
        digest: Its content hash.
        number: Requested number; the next one is used if it is taken.
        damaged: A version not to return, although it claims the same content.
        earlier: Its content hash by an earlier rule; empty if that is the same.

    Returns:
        The version's folder, or the existing one with the same content.
    """
    with lock_folder(home):  # one process at a time chooses a number
        info = DatasetInfo.read(hidden)
        carries = bool(info.other_features or info.tools)
        existing = _find_same_version(home, digest, read_provenance(hidden), damaged, carries, earlier)
        if existing:
            return existing
        taken = {_number(path) for path in home.iterdir() if VERSION.fullmatch(path.name)}
        if number < 1 or number in taken:
            number = max(taken, default=0) + 1
        root = home / f"v{number}-{digest[:8]}"
        publish(hidden, root)
    return root


def find_home(path: Path) -> tuple[Path, str]:
    """Return the destination of datasets derived from a dataset: the folder of all datasets, and the name.

    It is that of the version; another dataset gets its folder's name below `datasets/`.
    """
    home = path.resolve()
    if not VERSION.fullmatch(home.name):
        return FOLDER, make_name(home.name)
    # Keep the path as the user gave it, for short messages.
    shown = path.parent if path.parent.resolve() == home.parent and path.parent.name else home.parent
    return shown.parent, shown.name


def save(
    dataset: Dataset,
    provenance: Provenance,
    *,
    out: Path | None = None,
    name: str = "dataset",
    parent: Path | None = None,
    attachments: Mapping[str, bytes] | None = None,
) -> Path:
    """Write a dataset to the destination that a command's options give.

    Args:
        dataset: The dataset.
        provenance: Its provenance.
        out: Folder to write.
        name: Without `out` and `parent`, the next version of `datasets/<name>` is written.
        parent: Without `out`, the next version beside this dataset is written.
        attachments: Further files by their path in the dataset.

    Returns:
        The dataset's folder.
    """
    if out is not None:
        return write(dataset, out, provenance, attachments)
    folder, name = (FOLDER, name) if parent is None else find_home(resolve(parent))
    return write_version(dataset, name, provenance, folder, attachments)


def check_destination(*, out: Path | None = None, name: str = "dataset", parent: Path | None = None) -> None:
    """Check that `save` can write, before any work is done; arguments as for `save`.

    Raises:
        OutputExists: the folder exists.
        CannotWrite: it cannot be created.
        OptionError: the name is not a valid folder name.
    """
    if out is not None:
        return check_creatable(out)
    folder, name = (FOLDER, name) if parent is None else find_home(resolve(parent))
    check_name(name)
    return check_creatable(folder / name / "version")


def _number(path: Path) -> int:
    match = VERSION.fullmatch(path.name)
    return int(match.group(1)) if match else 0


def _find_same_version(
    home: Path,
    digest: str,
    provenance: Provenance | None,
    damaged: Path | None = None,
    carries: bool = False,
    earlier: str = "",
) -> Path | None:
    """Return the newest version with a content hash, the same source model and the same details of each episode.

    The content hash ignores pass-through features. If there are any, their files are compared: equal rows with other
    pictures or messages are another version.

    Args:
        home: Folder of the name's versions.
        digest: The content hash.
        provenance: Provenance with the SHA-256 of each file.
        damaged: A version not to return, although it claims the same content.
        carries: Whether there are pass-through features.
        earlier: The content hash by an earlier rule, which does not cover the tasks of frames; empty if there is none.
    """

    def identity(hashes: Mapping[str, str]) -> dict[str, str]:
        # equal rows with another source are another version
        source = {name: hashes[name] for name in (SOURCE, SOURCE_EFFECTS) if name in hashes}
        stored = {name: value for name, value in hashes.items() if name.startswith(PASSTHROUGH_FILES)}
        return source | (stored if carries else {})

    files = provenance.files if provenance else {}
    details = _list_episode_details(provenance)
    hashes = tuple(filter(None, (digest, earlier)))
    for path in reversed(list_versions(home)):
        if path.name.endswith(tuple(one[:8] for one in hashes)) and not (damaged and path.samefile(damaged)):
            known = read_provenance(path)
            if known is None or known.content_hash not in hashes:
                continue
            if known.content_hash != digest and not _has_rows(path, digest):
                continue
            if identity(known.files) == identity(files) and _list_episode_details(known) == details:
                return path
    return None


def _has_rows(root: Path, digest: str) -> bool:
    """Whether the rows of a version have a content hash."""
    from nas_data.dataset.read import read  # it needs this module

    try:
        return hash_content(read(root)) == digest
    except DatasetInvalid:
        return False


def _list_episode_details(provenance: Provenance | None) -> object:
    """Return what a target tells of its episodes beside their rows, as JSON stores it: registers and constants."""
    target = (provenance and provenance.target) or {}
    episodes = target.get(EPISODES)
    constants = [entry.get("constants") or {} for entry in episodes] if isinstance(episodes, list) else []
    details = {"registers": target.get(REGISTERS) or [], "constants": constants if any(constants) else []}
    return json.loads(encode_json(details))
