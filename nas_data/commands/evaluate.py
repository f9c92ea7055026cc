"""Compare φ or ψ with the baselines hold, source and command on any dataset."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.runs.progress import Counting, begin


@dataclass(frozen=True, kw_only=True)
class Evaluate(TakesModel):
    """Print one-step and open-loop errors of a checkpoint or model file on a dataset, beside simple baselines.

    Example: nas evaluate runs/phi/checkpoint datasets/arm_test --model arm.xml

    To compare a corrected model file with the model that it came from:

    Example: nas evaluate runs/gap/model.xml datasets/arm_test --model arm.xml
    """

    checkpoint: tyro.conf.Positional[Path]
    """Folder written by `nas train` (the run's folder, or its `checkpoint`), or a model: an MJCF or URDF file, or a
    robot's name."""
    dataset: tyro.conf.Positional[Path]
    """Dataset to evaluate on; it need not be paired."""
    model: str | None = None
    """Source: the model that φ corrects, or that a model file is compared with. Default: of φ and ψ, the one stored
    with the checkpoint or dataset; a model file is then evaluated alone, as `source`."""
    engine: str | None = None
    """Physics engine of the source: mujoco or bullet. Default: that of the pairing if it is stored, else mujoco."""
    episodes: tuple[int, ...] = ()
    """Use only these episodes; all by default."""

    def run(self) -> CommandResult:
        """Evaluate and return the tables."""
        from nas_data.api.evaluation import as_learned, evaluate, is_model
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset

        learned = None if is_model(self.checkpoint) else as_learned(self.checkpoint)
        root = versions.resolve(self.dataset)
        begin(f"reading {root}")
        dataset = Dataset.load(root, self.episodes or None)
        evaluation = evaluate(
            learned or self.checkpoint,
            dataset,
            model=self.model,
            engine=self.engine,
            plain_fit=False,
            actuators=self.actuators,
            count=Counting("rolling out"),
        )
        derived = dataset.origin.derived if dataset.origin else {}
        folder = learned.folder if learned else self.checkpoint
        seen = learned.network.provenance.get("dataset") if learned else None
        name = seen.get("name") if isinstance(seen, dict) else "unknown"
        origin = f"trained on {name}" if learned else "a model"
        head = [
            f"{folder} ({origin}) on {root}: {count_of(dataset.n_episodes, 'episode')}, "
            f"{count_of(dataset.n_frames, 'frame')}"
        ]
        head += [f"derived {key}: {how}" for key, how in derived.items()]
        data = {"checkpoint": folder, "dataset": root, "trained_on": seen, "derived": derived, **evaluation.to_json()}
        return CommandResult("\n".join([*head, "", evaluation.text(), "", evaluation.episodes_text()]), data)
