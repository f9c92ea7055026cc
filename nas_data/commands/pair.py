"""Add the source simulator's prediction of every transition, as a new version."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Pair(TakesModel):
    """Reset a source to every measured state, hold the command for one control step, store the prediction.

    Example: nas pair datasets/arm --model arm.xml
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    model: str
    """Source: an MJCF or URDF file with the dataset's joint names, or a robot's name."""
    engine: str = "mujoco"
    """Physics engine: mujoco or bullet."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Effect to add to the source, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json: effects and retuned parameters to add to the source. None by
    default."""
    out: Path | None = None
    """Write to exactly this folder, which must not exist; the default is the next version of the dataset's name,
    datasets/NAME."""

    def run(self) -> CommandResult:
        """Pair the dataset and write the new version."""
        from nas_data.api.pairing import PairingSource, make_pairs
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset
        from nas_data.dataset.origin import describe
        from nas_data.dataset.provenance import read_provenance

        root = versions.resolve(self.dataset)
        versions.check_destination(out=self.out, parent=root)
        begin(f"reading {root}")
        dataset = Dataset.load(root)
        derived = dict(dataset.origin.derived) if dataset.origin else {}
        source = PairingSource(
            model=self.model,
            engine=self.engine,
            effects=self.effect,
            report=self.effects,
            actuators=self.actuators,
        )
        begin(f"pairing {count_of(dataset.n_frames, 'transition')}")
        pairing = make_pairs(dataset, source)
        paired = pairing.dataset
        provenance, kept = describe(paired)
        begin("writing the dataset")
        folder = versions.save(paired, provenance, out=self.out, parent=root, attachments=kept)
        remarks = [*pairing.remarks, *versions.describe_older(folder)]
        lines = [*(f"derived {key}: {how}" for key, how in derived.items()), *remarks]
        done = (
            f"{count_of(paired.n_frames, 'transition')} of {count_of(paired.n_episodes, 'episode')} paired in "
            f"{pairing.seconds:.1f} s"
        )
        return CommandResult(
            "\n".join([f"{done} → {folder}", *(f"  {line}" for line in lines)]),
            {
                "dataset": folder,
                "content_hash": read_provenance(folder).content_hash,  # type: ignore[union-attr]  # just written
                "transitions": paired.n_frames,
                "seconds": pairing.seconds,
                "derived": derived,
                "source": pairing.source,
                "warnings": [*pairing.warnings, *remarks],
            },
        )
