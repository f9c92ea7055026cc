"""What `nas train delta` and `nas train forward` share: options, data, source, training, evaluation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import Counting, say


@dataclass(frozen=True, kw_only=True)
class Train(TakesModel):
    """Options of a training; None leaves the preset's value."""

    kind: ClassVar[Literal["delta", "forward"]]

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    out: Path | None = None
    """Folder for checkpoint, history and TensorBoard files; runs/KIND-NAME-seedN otherwise."""
    model: str | None = None
    """Source that the dataset was paired with, a model file or robot; needed only where the dataset keeps none."""
    engine: str | None = None
    """Engine of the source: mujoco or bullet; the one it was paired in where it is kept, else mujoco."""
    preset: str = "fast"
    """fast; few, for recordings of a few minutes (one layer, short windows, strong weight decay); symmetric, for as
    little of an arm that takes torques and whose model says how it is symmetric (φ corrects the torques); or paper (its
    published recipe: teacher forcing, batch 1, learning rate 0.01, 250 epochs)."""
    hidden: int | None = None
    """Units of each LSTM layer (128, 256 or 100 in the paper)."""
    epochs: int | None = None
    """Passes over the data with teacher forcing (with --updates 0, or where the source is not at hand)."""
    updates: int | None = None
    """Updates in free running; 0 trains by teacher forcing."""
    horizon: int | None = None
    """Longest free-running window [frames]."""
    validation: float | None = None
    """Share held out for early stopping: of the episodes, or of each where they are few."""
    episodes: Annotated[tuple[int, ...], tyro.conf.arg(metavar="N…")] = ()
    """Use only these episodes; all by default."""
    seed: int = 0
    """Seed of weights, split, order and windows."""
    device: str | None = None
    """torch device; a GPU where there is one by default."""

    def run(self) -> CommandResult:
        """Train, evaluate on the held-out episodes beside the baselines, and say where the checkpoint lies."""
        from nas_data.api.training import TrainingRequest, train
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset
        from nas_data.models.presets import preset
        from nas_data.models.run import CHECKPOINT

        options = preset(
            self.preset,
            hidden=self.hidden,
            epochs=self.epochs,
            updates=self.updates,
            horizon=self.horizon,
            validation=self.validation,
            seed=self.seed,
        )
        root = versions.resolve(self.dataset)
        name = versions.find_dataset_name(root).split("/")[0]
        folder = self.out or Path("runs") / f"{self.kind}-{name}-seed{self.seed}"
        request = TrainingRequest(
            kind=self.kind,
            options=options,
            model=self.model,
            engine=self.engine,
            actuators=self.actuators,
            out=folder,
            device=self.device,
            episodes=self.episodes,
            progress=say,
            count=Counting("rolling out what was held out"),
        )
        learned = train(Dataset.load(root, self.episodes), request)
        evaluation = learned.held_out
        text = f"{evaluation.text()}\n\n" if evaluation else ""
        title = f"Held out ({learned.split}):\n\n" if evaluation else ""
        return CommandResult(
            f"{title}{text}checkpoint → {folder / CHECKPOINT}",
            {
                "checkpoint": folder / CHECKPOINT,
                "held_out": learned.split,
                "history": folder / "history.json",
                "errors": evaluation.to_json() if evaluation else None,
            },
        )
