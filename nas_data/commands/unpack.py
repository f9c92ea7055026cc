"""Unpack a dataset that was shared as one file."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Unpack(Command):
    """Check a packed dataset and add it as a version under its name; nothing is overwritten.

    Example: nas unpack ergojr.nas.tar
    """

    file: tyro.conf.Positional[Path]
    """A file written by 'nas pack'."""
    folder: Path = Path("datasets")
    """Folder of your datasets; the result is FOLDER/NAME/VERSION."""

    def run(self) -> CommandResult:
        """Check and unpack the file."""
        from nas_data.dataset.content import hash_content
        from nas_data.dataset.read import read
        from nas_data.dataset.unpack import unpack

        begin(f"checking {self.file}")
        root = unpack(self.file, self.folder)
        dataset = read(root)
        return CommandResult(
            f"{count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'frame')} of "
            f"{dataset.robot_type}, hashes correct → {root}",
            {
                "dataset": root,
                "content_hash": hash_content(dataset),
                "episodes": dataset.n_episodes,
                "frames": dataset.n_frames,
            },
        )
