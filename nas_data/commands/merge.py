"""Merge datasets of one robot into a new version."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Merge(Command):
    """Merge datasets with the same joints, features and rate; episodes keep the given order.

    A single dataset becomes a new version with its own provenance, for example after an edit by LeRobot's tools.

    Example: nas merge datasets/monday datasets/tuesday --name week
    """

    datasets: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DATASET…")]
    """Datasets: folders, or datasets/NAME for the newest version of a name."""
    name: str | None = None
    """Name of the result: the next version below datasets/NAME; by default that of the first
    dataset."""
    out: Path | None = None
    """Write to exactly this folder, which must not exist, instead of a version of datasets/NAME."""

    def run(self) -> CommandResult:
        """Read, compare, merge and write."""
        from nas_data.dataset.content import hash_content
        from nas_data.dataset.derive_provenance import Original
        from nas_data.dataset.merge import list_merge_warnings, merge
        from nas_data.dataset.staging import refuse_existing
        from nas_data.dataset.versions import check_name, save

        if not self.datasets:
            raise OptionError("No dataset is given; run: nas merge DATASET DATASET…")
        if self.out is not None:
            refuse_existing(self.out)
        if self.name is not None:
            check_name(self.name)
        begin(f"merging {count_of(len(self.datasets), 'dataset')}")
        originals = [Original.read(path) for path in self.datasets]
        merged = merge(originals)
        folder = save(
            merged.dataset,
            merged.provenance,
            out=self.out,
            name=self.name or "dataset",
            parent=originals[0].root if self.name is None else None,
            attachments=merged.attachments,
        )
        notes = list(list_merge_warnings(originals))
        dataset = merged.dataset
        text = (
            f"{count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'frame')} of "
            f"{count_of(len(originals), 'dataset')} → {folder}"
        )
        return CommandResult(
            "\n".join([text, *(f"  note: {note}" for note in notes)]),
            {
                "dataset": folder,
                "content_hash": hash_content(dataset),
                "episodes": dataset.n_episodes,
                "frames": dataset.n_frames,
                "parents": [vars(original.parent) for original in originals],
                "notes": notes,
            },
        )
