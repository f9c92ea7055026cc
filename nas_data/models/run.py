"""Training loop: early stopping, checkpoints, TensorBoard, and continuation after an interruption."""

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch.utils.tensorboard import SummaryWriter

from nas_data.errors import OutputExists
from nas_data.models import checkpoint
from nas_data.models.lstm import DynamicsModel
from nas_data.models.optimiser import Optimiser
from nas_data.models.threads import one_thread
from nas_data.models.training import ModelTraining
from nas_data.runs.progress import begin

CHECKPOINT = "checkpoint"
HISTORY = "history.json"
STATE = "training_state.pt"
PARTIAL = f".{STATE}"
LEAST_IMPROVEMENT = 0.1  # a training that reduced the first validation error by a larger share is not stopped early


@dataclass
class TrainingProgress:
    """State of a training.

    Attributes:
        update: Number of the next update.
        best: Best validation error.
        stale: Validations since the best one.
        seconds: Time spent [s].
        history: One row per validation: update, loss, validation error, seconds.
    """

    update: int = 0
    best: float = float("inf")
    stale: int = 0
    seconds: float = 0.0
    history: list[dict[str, float | int]] = field(default_factory=list)


class TrainingRun:
    """A training in a folder; an interrupted and continued training has a bit-identical result."""

    def __init__(
        self,
        training: ModelTraining,
        folder: Path,
        report: Callable[[str], None],
        attachments: Mapping[str, bytes] | None = None,
    ) -> None:
        """Open the folder.

        Args:
            training: Model, data and options.
            folder: Folder for checkpoint, history and TensorBoard files.
            report: Called with one line per validation.
            attachments: Contents of further files of the checkpoint by name, such as the source.

        Raises:
            OutputExists: the folder holds a finished training, or one with other options.
        """
        self.training = training
        self.folder = folder
        self.report = report
        self.attachments = attachments
        self.progress = TrainingProgress()
        self.optimiser = Optimiser(training)
        self._restore()

    def run(self) -> DynamicsModel:
        """Train, and return the frozen model with the best validation error."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._store()  # the state file marks the folder as that of a training that can be continued
        self.writer = SummaryWriter(str(self.folder / "tensorboard"))
        self._clock = time.monotonic() - self.progress.seconds
        with one_thread():
            if not self.progress.history:
                self._validate(float("nan"))
            self._train()
        self.writer.close()
        (self.folder / HISTORY).write_text(json.dumps(self.progress.history, indent=1), encoding="utf-8")
        (self.folder / STATE).unlink(missing_ok=True)
        return checkpoint.load_for_inference(self.folder / CHECKPOINT)

    def _train(self) -> None:
        phase, progress = self.training.phase, self.progress
        losses: list[float] = []
        while progress.update < phase.updates and not self._is_stalled():
            begin(f"{phase.name}, update {progress.update + 1} of {phase.updates}")
            losses.append(self.optimiser.update(progress.update))
            progress.update += 1
            if progress.update % phase.per_validation == 0 or progress.update == phase.updates:
                self._validate(sum(losses) / len(losses))
                losses.clear()

    def _is_stalled(self) -> bool:
        """Return whether the training has hardly improved on its start and has not improved recently."""
        progress = self.progress
        # the negated comparison is also true if both errors are infinite
        no_gain = not progress.best < (1 - LEAST_IMPROVEMENT) * progress.history[0]["validation"]
        return no_gain and progress.stale > self.training.options.patience

    def _validate(self, loss: float) -> None:
        """Compute the validation error, save the best model, and store the state of the training."""
        begin("validating")
        model, progress = self.optimiser.model, self.progress
        error = self.training.validation_error(model)
        if not progress.history and not math.isfinite(error):
            error = self._shrink_shortcut()
        progress.stale += 1
        progress.seconds = time.monotonic() - self._clock
        if error < progress.best or not progress.history:
            progress.best, progress.stale = error, 0
            checkpoint.save(model, self.folder / CHECKPOINT, self.attachments)
        row = {"update": progress.update, "validation": error, "loss": loss, "seconds": round(progress.seconds, 1)}
        progress.history.append(row)
        step = len(progress.history)
        self.writer.add_scalar("validation", error, step)
        self.writer.add_scalar("loss", loss, step)
        mark = " *" if progress.stale == 0 else ""
        shown = f"{loss:9.5f}" if progress.update else "        –"  # no loss before the first update
        self.report(
            f"{self.training.phase.name} {progress.update:5d}/{self.training.phase.updates}  loss {shown}  "
            f"validation {error:9.5f}{mark}  {progress.seconds:6.1f} s"
        )
        self._store()

    def _shrink_shortcut(self) -> float:
        """Reduce a linear shortcut that diverges, report it, and return the new validation error."""
        share, error = self.training.shrink_shortcut()
        if share < 1:
            self.report(
                f"the linear shortcut diverges in closed loop on these data: training starts from {share:.1%} of it"
            )
        return error

    def _format_identity(self) -> str:
        return format_identity(self.training.model, asdict(self.training.options))

    def _store(self) -> None:
        content = {
            "identity": self._format_identity(),
            "progress": asdict(self.progress),
            "model": self.training.model.state_dict(),
            "optimiser": self.optimiser.adamw.state_dict(),
            "average": self.optimiser.average.state_dict() if self.optimiser.average else None,
        }
        partial = self.folder / PARTIAL
        torch.save(content, partial)
        partial.replace(self.folder / STATE)

    def _restore(self) -> None:
        path = self.folder / STATE
        if not path.is_file():
            self._check_empty()
            return
        content = torch.load(path, weights_only=True, map_location=self.training.device)
        if content["identity"] != self._format_identity():
            raise OutputExists(
                f"{self.folder} contains an unfinished training with other options, data or source; remove it or "
                "choose another --out."
            )
        self.training.model.load_state_dict(content["model"])
        self.optimiser.adamw.load_state_dict(content["optimiser"])
        if self.optimiser.average is not None:
            self.optimiser.average.load_state_dict(content["average"])
        self.progress = TrainingProgress(**content["progress"])
        self.report(f"continuing at update {self.progress.update} of {self.folder}")

    def _check_empty(self) -> None:
        """Raise OutputExists unless the folder is empty, except for a partially written state."""
        if self.folder.is_dir() and all(entry.name == PARTIAL for entry in self.folder.iterdir()):
            return
        if (self.folder / HISTORY).is_file() and (self.folder / CHECKPOINT / checkpoint.CONFIG).is_file():
            raise OutputExists(self._describe_finished())
        if self.folder.exists():
            raise OutputExists(f"{self.folder} exists and is not a training; choose another --out or remove it.")

    def _describe_finished(self) -> str:
        """Return the error for a folder with a finished training: this one or another one."""
        stored = self.folder / CHECKPOINT
        model = checkpoint.load_for_inference(stored)
        if format_identity(model, model.provenance.get("training")) == self._format_identity():
            return (
                f"{self.folder} holds this training, finished: its checkpoint is {stored}; to train again, remove it."
            )
        return (
            f"{self.folder} holds a finished training of other options, data or source (checkpoint {stored}); "
            "choose another --out or remove it."
        )


def format_identity(model: DynamicsModel, options: object) -> str:
    """Return options, kind, data and source as text; a training continues only if they are equal."""
    data = {key: model.provenance.get(key) for key in ("dataset", "source")}
    return json.dumps({"options": options, "kind": model.kind, **data}, sort_keys=True, default=str)
