"""Datasets in memory with their origin: loading, saving, conversion to a table."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from nas_data.dataset import versions
from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import Original, describe_change, make_unknown_provenance
from nas_data.dataset.external import audit_external
from nas_data.dataset.joints import NAMES, REMEDY, SAME_NAMES
from nas_data.dataset.layout import PROVENANCE
from nas_data.dataset.provenance import Parent, Provenance, format_current_time, read_package_versions, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.target_episodes import select_episodes
from nas_data.dataset.transitions import as_transitions
from nas_data.dataset.write import encode_json
from nas_data.errors import DatasetInvalid, JointMismatch
from nas_data.log import warn

if TYPE_CHECKING:
    import pandas

TO_SI = "convert the columns first, numpy.radians(states), and set the units of the features to match"
IN_PYTHON = {  # remedies of commands → those for a dataset in memory
    REMEDY: TO_SI,
    NAMES: "make it with its joints: nas_data.Dataset.from_arrays(positions, commands, rate=rate, joints=names)",
    SAME_NAMES: "name the same joints in the features of both",
}
EDITED = "edited in Python"


@dataclass(frozen=True)
class Origin:
    """Origin of a dataset in memory; `save` writes it as provenance.

    Attributes:
        dataset: The content that the provenance describes.
        provenance: Content of `meta/nas.json`.
        derived: Features derived while reading: feature → how.
        root: Folder that it was read from; None if it was made in memory.
        recorded: Content of that folder, without derived features.
        attachments: Extra files by path, such as the source model of the predictions.
        noticed: Warnings of the audits, already shown on stderr.
    """

    dataset: Dataset
    provenance: Provenance
    derived: Mapping[str, str] = field(default_factory=dict)
    root: Path | None = None
    recorded: Dataset | None = None
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    noticed: tuple[str, ...] = ()

    def select(self, episodes: Sequence[int]) -> "Origin":
        """Return the origin of a selection of episodes."""
        target = select_episodes(self.provenance.target, episodes, self.dataset.n_episodes)
        return replace(self, provenance=replace(self.provenance, target=target))

    @cached_property
    def parents(self) -> tuple[Parent, ...]:
        """Parents for the provenance of a dataset made from it."""
        if self.root is None or self.recorded is None:
            return self.provenance.parents
        return (versions.make_parent(self.root, self.recorded),)


def load(path: Path, episodes: Iterable[int] | None = None) -> Dataset:
    """Read a dataset; see `Dataset.load`."""
    root = versions.resolve(path)
    recorded = read(root)
    part = recorded.select_each_once(episodes)
    dataset, derived, noticed = audit_external(root, part)
    original = Original(root, recorded, read_provenance(root))
    kept, before = original.attachments, original.provenance or make_unknown_provenance(recorded)
    notes = [before.notes]
    if original.is_changed:
        noticed = (*noticed, describe_change(str(root)))
        notes.append(describe_change(original.parent.name))
    warn(noticed)
    provenance = replace(before, derived={**before.derived, **derived}, notes="\n".join(filter(None, notes)))
    if part.numbers:
        provenance = replace(provenance, target=select_episodes(provenance.target, part.numbers, recorded.n_episodes))
    return replace(dataset, origin=Origin(dataset, provenance, derived, root, recorded, kept, noticed))


def with_origin(dataset: Dataset) -> Dataset:
    """Return a dataset as transitions with an origin; without one of its own, it counts as made in Python.

    Raises:
        JointMismatch, DatasetInvalid: it cannot be converted to transitions.
    """
    if dataset.origin is not None:
        return dataset
    try:
        complete, derived = as_transitions(dataset)
    except (DatasetInvalid, JointMismatch) as error:
        said = str(error)
        for of_command, in_python in IN_PYTHON.items():
            said = said.replace(of_command, in_python)
        raise type(error)(said) from None
    provenance = Provenance(how="edited", robot=dataset.robot_type, derived=derived, notes=EDITED)
    return replace(complete, origin=Origin(complete, provenance, derived))


def describe_identity(dataset: Dataset) -> dict[str, object]:
    """Return the name, content hash and episodes by which checkpoints refer to a dataset.

    Episodes that were loaded from a folder are told by the folder's hash and their numbers in it; no numbers stand for
    all. Any other dataset is told by its own hash.
    """
    origin = dataset.origin
    if origin is not None and find_root(dataset) is not None:
        told, numbers = origin.parents[0], dataset.numbers
    else:
        named = origin.parents[0].name if origin and origin.parents else dataset.robot_type
        told, numbers = Parent(named, hash_content(dataset)), ()
    return {"name": told.name, "content_hash": told.content_hash, "episodes": list(numbers)}


def find_root(dataset: Dataset) -> Path | None:
    """Return the folder from which a dataset, or a part of it, was read; None if it was made or changed in memory."""
    origin = dataset.origin
    return origin.root if origin is not None and is_unchanged(dataset, origin) else None


def is_unchanged(dataset: Dataset, origin: Origin) -> bool:
    """Whether a dataset still has the content that its origin describes."""
    if dataset.columns is origin.dataset.columns and dataset.features is origin.dataset.features:
        return True
    return hash_content(dataset) == hash_content(origin.dataset)


def describe(dataset: Dataset) -> tuple[Provenance, Mapping[str, bytes]]:
    """Return provenance and extra files of a dataset to be written."""
    origin = with_origin(dataset).origin
    assert origin is not None
    is_part = origin.root is not None and bool(dataset.numbers)
    if is_part or not is_unchanged(dataset, origin):
        provenance = origin.provenance
        notes = "\n".join(filter(None, [provenance.notes, EDITED]))
        edited = {
            "how": "edited",
            "when": format_current_time(),
            "packages": dict(read_package_versions()),
            "notes": notes,
        }
        return replace(provenance, **edited, parents=origin.parents), origin.attachments  # type: ignore[arg-type]
    if origin.derived and origin.root is not None:
        return replace(origin.provenance, parents=origin.parents), origin.attachments
    return origin.provenance, origin.attachments


def save(dataset: Dataset, path: Path) -> Path:
    """Write a dataset as the next version of a name; see `Dataset.save`."""
    if versions.VERSION.fullmatch(path.name):
        path = path.parent
    provenance, files = describe(dataset)
    return versions.write_version(dataset, path.name, provenance, path.parent, files)


@contextmanager
def kept_folders(dataset: Dataset) -> Iterator[list[Path]]:
    """Yield the folders that may hold the source of a paired dataset."""
    origin = dataset.origin
    if origin is None:
        yield []
        return
    if origin.root is not None:
        yield [origin.root]
        return
    with TemporaryDirectory() as folder:
        files = {**origin.attachments, PROVENANCE: encode_json(origin.provenance.to_json())}
        for name, content in files.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        yield [Path(folder)]


def as_frame(dataset: Dataset) -> "pandas.DataFrame":
    """Return a dataset as a table; see `Dataset.to_pandas`."""
    import pandas as pd

    lengths = np.asarray(dataset.lengths)
    frame = np.arange(dataset.n_frames) - np.repeat(dataset.starts, lengths)
    rows = pd.MultiIndex.from_arrays([np.repeat(np.arange(len(lengths)), lengths), frame], names=("episode", "frame"))
    parts = {key: pd.DataFrame(dataset.columns[key], rows, item.names) for key, item in dataset.features.items()}
    return pd.concat(parts, axis=1, names=("feature", "component"))
