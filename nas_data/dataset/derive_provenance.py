"""Provenance and attached files that a dataset inherits from the datasets it is made from."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from nas_data.dataset import layout
from nas_data.dataset.content import choose_content_hash
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import Parent, Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.target_episodes import join_targets, select_episodes
from nas_data.dataset.versions import find_dataset_name, resolve
from nas_data.visible_files import list_visible_files

Item = TypeVar("Item")
OWN_FILES = {layout.INFO, layout.STATS, layout.TASKS, layout.PROVENANCE}


@dataclass(frozen=True)
class Original:
    """A dataset on disk that another is made from.

    Attributes:
        root: Its folder.
        dataset: Its content.
        provenance: Its provenance; None if LeRobot's tools dropped it.
    """

    root: Path
    dataset: Dataset
    provenance: Provenance | None

    @classmethod
    def read(cls, path: Path) -> "Original":
        """Read a dataset, or the newest version of a name.

        Raises:
            DatasetNotFound: there is no dataset at the path.
            DatasetInvalid: it is damaged.
        """
        root = resolve(path)
        return cls(root, read(root), read_provenance(root))

    @cached_property
    def parent(self) -> Parent:
        """Entry for the provenance of datasets made from it."""
        stored = self.provenance.content_hash if self.provenance else ""
        return Parent(find_dataset_name(self.root), choose_content_hash(self.dataset, stored))

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """Unaltered files that are not part of LeRobot's format, such as the source model."""
        return read_attachments(self.root, self.provenance)

    @cached_property
    def is_changed(self) -> bool:
        """Whether the content is not the one that its provenance describes."""
        return self.provenance is not None and self.provenance.content_hash not in ("", self.parent.content_hash)

    def remarks(self) -> Iterator[str]:
        """Yield a sentence on each loss or doubt in datasets made from it."""
        if self.provenance is None:
            yield (
                f"{self.root} has no provenance (LeRobot wrote it, or LeRobot's tools made it): its origin is unknown; "
                "its content hash is recorded from now on."
            )
        elif self.is_changed:
            yield describe_change(str(self.root))


@dataclass(frozen=True)
class Derived:
    """A dataset to be written.

    Attributes:
        dataset: Its content.
        provenance: Its provenance.
        attachments: Further files by their path in the dataset.
    """

    dataset: Dataset
    provenance: Provenance
    attachments: Mapping[str, bytes]


def describe_change(dataset: str) -> str:
    """Return a sentence about a dataset whose content its provenance does not describe."""
    return (
        f"{dataset} was changed after nas wrote it (LeRobot appended episodes?): "
        "its provenance may not hold for all episodes."
    )


def read_attachments(root: Path, provenance: Provenance | None) -> dict[str, bytes]:
    """Return the unaltered files of a dataset that are not part of LeRobot's format, by path.

    Only files below `meta/` are read, whatever paths the provenance names, because it may be untrusted.
    """
    recorded = provenance.files if provenance else {}
    found = subtasks([root]) if layout.SUBTASKS not in recorded else {}
    for path in list_visible_files(root / "meta", "**/*"):
        name = path.relative_to(root).as_posix()
        if name not in recorded or name in OWN_FILES or name.startswith("meta/episodes/") or path.is_symlink():
            continue
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() == recorded[name]:
            found[name] = content
    return found


def subtasks(roots: Iterable[Path]) -> dict[str, bytes]:
    """Return the table of subtasks by its path, if all datasets have the same."""
    paths = [root / layout.SUBTASKS for root in roots]
    tables = [path.read_bytes() for path in paths if path.is_file()]
    return {layout.SUBTASKS: tables[0]} if tables and tables == tables[:1] * len(paths) else {}


def inherit(originals: Sequence[Original], deed: str, chosen: Sequence[int] | None = None) -> Provenance:
    """Return the provenance of a dataset that consists of episodes of others.

    Entries that all originals share (source, target, signal) are kept, and of different targets those by episode, such
    as the servos' registers; others can be found through the parents.

    Args:
        originals: The original datasets, at least one.
        deed: Description of the change.
        chosen: For each new episode, its number in the only original; None for all episodes of all originals.
    """
    before = [original.provenance or make_unknown_provenance(original.dataset) for original in originals]
    changes = [describe_change(original.parent.name) for original in originals if original.is_changed]
    notes = [*(item.notes for item in before), *changes, deed]
    target = join_targets(
        [(item.target, original.dataset.n_episodes) for item, original in zip(before, originals, strict=True)]
    )
    return Provenance(
        how="edited",
        robot=find_common_value(item.robot for item in before) or originals[0].dataset.robot_type,
        source=find_common_value(item.source for item in before),
        target=target if chosen is None else select_episodes(before[0].target, chosen, originals[0].dataset.n_episodes),
        signal=find_common_value(item.signal for item in before),
        seeds=_remove_duplicates(seed for item in before for seed in item.seeds),
        parents=_remove_duplicates(original.parent for original in originals),
        derived=_join_texts(item.derived for item in before),
        contiguous=all(item.contiguous for item in before),
        notes="\n".join(_remove_duplicates(line for note in notes for line in note.splitlines())),
    )


def make_unknown_provenance(dataset: Dataset) -> Provenance:
    """Return the provenance of a dataset that has none of its own."""
    return Provenance(how="lerobot", robot=dataset.robot_type)


def find_common_value(values: Iterable[Item | None]) -> Item | None:
    """Return the value that all share; None if they differ."""
    first, *others = values
    return first if all(value == first for value in others) else None


def _remove_duplicates(values: Iterable[Item]) -> tuple[Item, ...]:
    """Return each value once, in the order of first appearance."""
    return tuple(dict.fromkeys(values))


def _join_texts(mappings: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Join texts by key; each text once."""
    texts: dict[str, list[str]] = {}
    for mapping in mappings:
        for key, text in mapping.items():
            texts.setdefault(key, []).append(text)
    return {key: "; or ".join(_remove_duplicates(found)) for key, found in texts.items()}
