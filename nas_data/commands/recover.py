"""Rescue the complete episodes of a half-written or damaged dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin

if TYPE_CHECKING:
    from nas_data.dataset.recover import Rescue


@dataclass(frozen=True, kw_only=True)
class Recover(Command):
    """Write a new dataset of the complete episodes of an interrupted or damaged recording.

    Episodes up to the first lost one are rescued, including those in files that LeRobot did not finish. The damaged
    dataset is not changed.

    Example: nas recover recordings/monday --name monday
    """

    dataset: tyro.conf.Positional[Path]
    """Damaged dataset: its folder, datasets/NAME, or the hidden folder (….partial-…) of a killed process."""
    beyond: bool = False
    """Also rescue the complete episodes after a lost one; they get new numbers."""
    like: Path | None = None
    """A dataset with the same names, units and rate, used if meta/info.json is lost."""
    name: str | None = None
    """Name of the result: the next version below datasets/NAME; that of the damaged dataset by default."""
    out: Path | None = None
    """Write to exactly this folder, which must not exist, instead of a version of datasets/NAME."""

    def run(self) -> CommandResult:
        """Find, check and write the complete episodes."""
        from nas_data.dataset.recover import find_damaged, recover
        from nas_data.dataset.staging import refuse_existing
        from nas_data.dataset.versions import check_name, resolve

        if self.out is not None:
            refuse_existing(self.out)
        if self.name is not None:
            check_name(self.name)
        like = resolve(self.like) if self.like is not None else None
        root = find_damaged(self.dataset)
        begin(f"rescuing {root}")
        rescue = recover(root, self.beyond, like)
        folder = self._write(rescue)
        return CommandResult("\n".join(describe_rescue(rescue, folder)), make_json(rescue, folder))

    def _write(self, rescue: "Rescue") -> Path | None:
        """Write the rescued episodes; return None if nothing was damaged."""
        from nas_data.dataset.recover import find_destination
        from nas_data.dataset.versions import FOLDER, write_version
        from nas_data.dataset.write import write

        derived = rescue.derived
        if derived is None:
            return None
        if self.out is not None:
            return write(derived.dataset, self.out, derived.provenance, derived.attachments)
        folder, name = (FOLDER, self.name) if self.name is not None else find_destination(rescue.root)
        return write_version(
            derived.dataset, name, derived.provenance, folder, derived.attachments, damaged=rescue.root
        )


def describe_rescue(rescue: "Rescue", folder: Path | None) -> list[str]:
    """Describe what was rescued and what was lost."""
    if folder is None or rescue.derived is None:
        return [
            f"{rescue.root} is complete: {count_of(len(rescue.kept), 'episode')}; there is nothing to rescue. To check "
            "values and metadata: nas verify."
        ]
    dataset = rescue.derived.dataset
    kept = count_of(dataset.n_episodes, "episode")
    if rescue.promised >= len(rescue.kept):
        kept = f"{dataset.n_episodes} of {count_of(rescue.promised, 'episode')}"
    return [
        f"{kept}, {count_of(dataset.n_frames, 'frame')} rescued from {rescue.root} → {folder}",
        *(f"  {report}" for report in rescue.reports),
        *(
            [f"  {count_of(len(rescue.left), 'complete episode')} after a lost one: --beyond rescues them too"]
            * bool(rescue.left)
        ),
    ]


def make_json(rescue: "Rescue", folder: Path | None) -> dict[str, object]:
    """Return the same for JSON."""
    return {
        "dataset": folder,
        "damaged": rescue.root,
        "whole": rescue.derived is None,
        "episodes_promised": rescue.promised,
        "episodes_kept": rescue.kept,
        "episodes_left": rescue.left,
        "reports": rescue.reports,
    }
