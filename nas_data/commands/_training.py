"""Base of `nas train delta` and `nas train forward`: options, data, source, training, evaluation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import CommandResult
from nas_data.runs.progress import Counting, begin, say


@dataclass(frozen=True, kw_only=True)
class Train(TakesModel):
    """Options of a training."""

    kind: ClassVar[Literal["delta", "forward"]]

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    out: Path | None = None
    """Folder for checkpoint, history and TensorBoard files; runs/KIND-NAME-seedN by default."""
    model: str | None = None
    """Source that the dataset was paired with, a model file or robot; only needed if the dataset stores none."""
    engine: str | None = None
    """Physics engine of the source: mujoco or bullet. Default: that of the pairing if it is stored, else mujoco."""
    preset: str | None = None
    """Hyperparameters: stiction, by default for φ of an arm that takes positions (joints stand still below a threshold
    that is learned); fast, by default otherwise; few, for recordings of a few minutes (one layer, short windows, strong
    weight decay); symmetric, for equally short recordings of a torque-controlled arm whose model states its symmetries
    (φ corrects the torques); or paper (teacher forcing, batch 1, learning rate 0.01, 250 epochs)."""
    hidden: int | None = None
    """Units of each LSTM layer (128, 256 or 100 in the paper); the preset's by default."""
    epochs: int | None = None
    """Passes over the data with teacher forcing (with --updates 0, or if the source is not available); the preset's by
    default."""
    updates: int | None = None
    """Updates with free-running (multi-step) rollouts; 0 trains by teacher forcing. The preset's by default."""
    horizon: int | None = None
    """Longest free-running rollout [frames]; the preset's by default."""
    validation: float | None = None
    """Share held out for early stopping: of the episodes, or of the frames of each episode if there are few. The
    preset's by default."""
    episodes: Annotated[tuple[int, ...], tyro.conf.arg(metavar="N…")] = ()
    """Use only these episodes; all by default."""
    seed: int = 0
    """Seed of the initial weights, the split, and the order and windows of the training data."""
    device: str | None = None
    """Device of PyTorch, such as cpu or cuda; by default a GPU if there is one, else the CPU."""

    def run(self) -> CommandResult:
        """Train, evaluate on the held-out episodes against the baselines, and report the path of the checkpoint."""
        from nas_data.api.training import TrainingRequest, train
        from nas_data.dataset import versions
        from nas_data.dataset.dataset import Dataset
        from nas_data.models.presets import choose_preset, preset
        from nas_data.models.run import CHECKPOINT

        root = versions.resolve(self.dataset)
        begin(f"reading {root}")
        dataset = Dataset.load(root, self.episodes or None)
        name = versions.find_dataset_name(root).split("/")[0]
        folder = self.out or Path("runs") / f"{self.kind}-{name}-seed{self.seed}"
        options = preset(
            self.preset or choose_preset(self.kind, dataset.commands_positions),
            hidden=self.hidden,
            epochs=self.epochs,
            updates=self.updates,
            horizon=self.horizon,
            validation=self.validation,
            seed=self.seed,
        )
        request = TrainingRequest(
            kind=self.kind,
            options=options,
            model=self.model,
            engine=self.engine,
            actuators=self.actuators,
            out=folder,
            device=self.device,
            progress=say,
            count=Counting("rolling out held-out episodes"),
        )
        learned = train(dataset, request)
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
