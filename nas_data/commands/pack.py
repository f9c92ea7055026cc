"""Pack a dataset into one file to share it."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Pack(Command):
    """Pack a dataset into one uncompressed tar file; the same dataset gives identical bytes.

    The recipient runs: nas unpack FILE

    Example: nas pack datasets/ergojr_sample --out ergojr.nas.tar
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset: a folder, or datasets/NAME for its newest version."""
    out: Path | None = None
    """Output file; NAME-VERSION.nas.tar in the current folder by default."""

    def run(self) -> CommandResult:
        """Check the dataset and pack it."""
        from nas_data.dataset.pack import pack

        begin(f"packing {self.dataset}")
        file, manifest = pack(self.dataset, self.out)
        size = file.stat().st_size
        return CommandResult(
            f"{count_of(len(manifest.files), 'file')}, {size / 1e6:.2f} MB → {file}",
            {"file": file, "bytes": size, "files": len(manifest.files), "content_hash": manifest.content_hash},
        )
