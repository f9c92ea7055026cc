"""Running a training: updates, early stopping, checkpoints, TensorBoard, and going on after an interruption."""

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
from nas_data.models.optimiser import Descent
from nas_data.models.threads import one_thread
from nas_data.models.training import ModelTraining

CHECKPOINT = "checkpoint"
HISTORY = "history.json"
STATE = "training_state.pt"
PARTIAL = f".{STATE}"
LEARNED = 0.1  # of the first validation error: who brought it down by more is worth going on with


@dataclass
class TrainingProgress:
    """Where a training stands.

    Attributes:
        update: Next update.
        best: Best validation error so far.
        stale: Validations since then.
        seconds: Time spent.
        history: One row a validation: update, loss, validation error, seconds.
    """

    update: int = 0
    best: float = float("inf")
    stale: int = 0
    seconds: float = 0.0
    history: list[dict[str, float | int]] = field(default_factory=list)


class TrainingRun:
    """A training in a folder, which can be interrupted and continued; the result is bit for bit the same."""

    def __init__(
        self,
        training: ModelTraining,
        folder: Path,
        report: Callable[[str], None],
        attachments: Mapping[str, bytes] | None = None,
    ) -> None:
        """Open the folder.

        Args:
            training: What to train.
            folder: Where the checkpoint, history and TensorBoard files go.
            report: Receives a line per validation.
            attachments: Files kept in the checkpoint: the source.

        Raises:
            OutputExists: the folder holds a finished training, or one of other options.
        """
        self.training = training
        self.folder = folder
        self.report = report
        self.attachments = attachments
        self.progress = TrainingProgress()
        self.descent = Descent(training)
        self._restore()

    def run(self) -> DynamicsModel:
        """Train to the end and return the frozen model of the best validation."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._store()  # from now on the folder can be told from a stranger's, and training goes on in it
        self.writer = SummaryWriter(str(self.folder / "tensorboard"))
        self._clock = time.monotonic() - self.progress.seconds
        with one_thread():
            if not self.progress.history:
                self._validate(float("nan"))
            self._train()
        self.writer.close()
        (self.folder / HISTORY).write_text(json.dumps(self.progress.history, indent=1), encoding="utf-8")
        (self.folder / STATE).unlink(missing_ok=True)
        return checkpoint.load_frozen(self.folder / CHECKPOINT)

    def _train(self) -> None:
        phase, progress = self.training.phase, self.progress
        losses: list[float] = []
        while progress.update < phase.updates and not self._is_in_vain():
            losses.append(self.descent.update(progress.update))
            progress.update += 1
            if progress.update % phase.per_validation == 0 or progress.update == phase.updates:
                self._validate(sum(losses) / len(losses))
                losses.clear()

    def _is_in_vain(self) -> bool:
        """Return whether the training has hardly got better than its start, and not of late."""
        progress = self.progress
        hardly = not progress.best < (1 - LEARNED) * progress.history[0]["validation"]  # nor where both diverge
        return hardly and progress.stale > self.training.options.patience

    def _validate(self, loss: float) -> None:
        """Measure the validation error, keep the best model, store where the training stands."""
        model, progress = self.descent.model, self.progress
        error = self.training.validation_error(model)
        if not progress.history and not math.isfinite(error):
            error = self._soften()
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
        shown = f"{loss:9.5f}" if progress.update else "        –"  # nothing was learned yet
        self.report(
            f"{self.training.phase.name} {progress.update:5d}/{self.training.phase.updates}  loss {shown}  "
            f"validation {error:9.5f}{mark}  {progress.seconds:6.1f} s"
        )
        self._store()

    def _soften(self) -> float:
        """Make the start bounded where it diverges, say so, and return the validation error from there."""
        share, error = self.training.soften()
        if share < 1:
            self.report(
                f"the linear shortcut diverges in closed loop on these data: training starts from {share:.1%} of it"
            )
        return error

    def _identity(self) -> str:
        return identity(self.training.model, asdict(self.training.options))

    def _store(self) -> None:
        content = {
            "identity": self._identity(),
            "progress": asdict(self.progress),
            "model": self.training.model.state_dict(),
            "optimiser": self.descent.optimiser.state_dict(),
            "average": self.descent.average.state_dict() if self.descent.average else None,
        }
        partial = self.folder / PARTIAL
        torch.save(content, partial)
        partial.replace(self.folder / STATE)

    def _restore(self) -> None:
        path = self.folder / STATE
        if not path.is_file():
            self._check_free()
            return
        content = torch.load(path, weights_only=True, map_location=self.training.device)
        if content["identity"] != self._identity():
            raise OutputExists(
                f"{self.folder} holds an unfinished training of other options, data or source; remove it."
            )
        self.training.model.load_state_dict(content["model"])
        self.descent.optimiser.load_state_dict(content["optimiser"])
        if self.descent.average is not None:
            self.descent.average.load_state_dict(content["average"])
        self.progress = TrainingProgress(**content["progress"])
        self.report(f"going on at update {self.progress.update} of {self.folder}")

    def _check_free(self) -> None:
        """Refuse a folder that holds something; what a first state that could not be written left does not count."""
        if self.folder.is_dir() and all(entry.name == PARTIAL for entry in self.folder.iterdir()):
            return
        if (self.folder / HISTORY).is_file() and (self.folder / CHECKPOINT / checkpoint.CONFIG).is_file():
            raise OutputExists(self._finished())
        if self.folder.exists():
            raise OutputExists(f"{self.folder} exists and holds something else; choose another --out or remove it.")

    def _finished(self) -> str:
        """Say that the training was done before, or that the folder holds the result of another."""
        place = self.folder / CHECKPOINT
        model = checkpoint.load_frozen(place)
        if identity(model, model.provenance.get("training")) == self._identity():
            return f"{self.folder} holds this training, finished: its checkpoint is {place}; to train again, remove it."
        return (
            f"{self.folder} holds a finished training of other options, data or source (checkpoint {place}); "
            "choose another --out or remove it."
        )


def identity(model: DynamicsModel, options: object) -> str:
    """Return what must be equal for a training to go on: options, kind, data and source."""
    data = {key: model.provenance.get(key) for key in ("dataset", "source")}
    return json.dumps({"options": options, "kind": model.kind, **data}, sort_keys=True, default=str)
