"""What a kind is: a way to predict that is learned from some transitions."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data import registry
from nas_data.dataset.dataset import Dataset
from nas_data.models.lstm import DynamicsModel
from nas_data.models.presets import TrainingOptions
from nas_data.sources import SourceModel

if TYPE_CHECKING:
    from nas_data.studies.ablation.naming import NamedSource  # what only trains does not depend on the search

FOLDER = "studies.ablation.kinds"


@dataclass(frozen=True)
class Lesson:
    """What a kind learns from.

    Attributes:
        data: Transitions of the subset alone.
        root: Folder of the dataset that they are from, for names and errors.
        source: Plain source; None where there is none.
        effects: A gap report's folder, or its effects.json, to be used instead of naming them from the subset.
        options: Of the training, its seed included.
        folder: Empty folder for working files.
    """

    data: Dataset
    root: Path
    source: SourceModel | None
    effects: Path | None
    options: TrainingOptions
    folder: Path

    @property
    def plain(self) -> SourceModel:
        """The plain source, of a kind that needs one."""
        assert self.source is not None  # the sweep checks it before anything is learned
        return self.source


@dataclass(frozen=True)
class Learned:
    """A predictor.

    Attributes:
        model: φ or ψ; None where the source predicts alone.
        source: Source that it needs; None for ψ.
        named: What was named, where something was.
    """

    model: DynamicsModel | None
    source: SourceModel | None
    named: "NamedSource | None" = None


@dataclass(frozen=True)
class ModelKind:
    """A kind; the file `ablation/kinds/a_b.py` holds the kind `a_b` as `KIND`.

    Attributes:
        label: Its name in tables and figures.
        learn: What makes a predictor of a lesson.
        trains: Whether a network is trained, so that options of training count.
        needs_source: Whether it needs a source.
        needs_pairs: Whether it needs the source's prediction for each transition in the dataset.
        names: Whether it names effects.
    """

    label: str
    learn: Callable[[Lesson], Learned]
    trains: bool = True
    needs_source: bool = False
    needs_pairs: bool = False
    names: bool = False


def kinds() -> tuple[str, ...]:
    """Return the names of all kinds."""
    return registry.names(FOLDER)


def find_kind(name: str) -> ModelKind:
    """Return a kind by its name.

    Raises:
        UnknownName: there is no such kind; lists those there are.
    """
    return registry.value(FOLDER, name, "kind", ModelKind)
