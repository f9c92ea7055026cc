"""A trained model φ or ψ, which can be evaluated, saved and loaded."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.models import checkpoint
from nas_data.models.evaluation import Evaluation
from nas_data.models.lstm import DynamicsModel, Kind
from nas_data.sources import read_kept_files


@dataclass(frozen=True, repr=False)
class LearnedModel:
    """φ or ψ, frozen.

    Attributes:
        network: The network, in evaluation mode.
        source: Files of the source that φ corrects, by name.
        split: Description of the data held out for early stopping.
        held_out: Errors on these data; None without a source, or for a model read from a folder.
        history: One row per validation: update, validation error, loss, seconds.
        trained_on: The recording; None for a model read from a folder.
        folder: Its checkpoint; None if it is only in memory.
    """

    network: DynamicsModel
    source: Mapping[str, bytes] = field(default_factory=dict)
    split: str = ""
    held_out: Evaluation | None = None
    history: tuple[Mapping[str, float], ...] = ()
    trained_on: Dataset | None = None
    folder: Path | None = None

    def __repr__(self) -> str:
        """Return kind, joints and held-out error in one line."""
        name = {"delta": "φ", "forward": "ψ"}[self.kind]
        error = ""
        if self.held_out is not None:
            errors = next(iter(self.held_out.open_loop.values()))
            error = f"; held-out open-loop error {errors.overall:.3g} {errors.unit.si}"
        return f"LearnedModel({name} of {', '.join(self.joints)} at {self.network.fps:g} Hz{error})"

    @property
    def kind(self) -> Kind:
        """`delta` for φ, `forward` for ψ."""
        return self.network.kind

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of its joints."""
        return tuple(self.network.joints)

    @classmethod
    def load(cls, folder: str | Path) -> "LearnedModel":
        """Read a checkpoint.

        Args:
            folder: Folder written by `nas train` or `save`: the checkpoint, or the training's folder.

        Raises:
            CheckpointError: it is missing or damaged.
        """
        place = checkpoint.find_checkpoint(Path(folder))
        return cls(checkpoint.load_for_inference(place), read_kept_files(place), folder=place)

    def save(self, folder: str | Path) -> Path:
        """Write a checkpoint for use by every command; an older one in the folder is replaced.

        Raises:
            OutputExists: the folder holds something else, such as a training.
        """
        Path(folder).parent.mkdir(parents=True, exist_ok=True)
        return checkpoint.save(self.network, Path(folder), self.source)
