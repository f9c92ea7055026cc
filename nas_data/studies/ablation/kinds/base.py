"""Interface of kinds: predictors that are learned from transitions."""

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
class TrainingInput:
    """Input of a kind.

    Attributes:
        data: Transitions of the subset.
        root: Folder of their dataset, for names and error messages.
        source: Plain source; None if there is none.
        effects: A gap report's folder, or its effects.json, to use instead of naming.
        options: Options of the training, seed included.
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
        """The plain source, for kinds that need one."""
        assert self.source is not None  # the sweep checks it before anything is learned
        return self.source


@dataclass(frozen=True)
class TrainedPredictor:
    """A predictor.

    Attributes:
        model: φ or ψ; None if the source predicts alone.
        source: Its source; None for ψ.
        named: Named effects, if any.
    """

    model: DynamicsModel | None
    source: SourceModel | None
    named: "NamedSource | None" = None


@dataclass(frozen=True)
class ModelKind:
    """A kind; the file `ablation/kinds/a_b.py` holds the kind `a_b` as `KIND`.

    Attributes:
        label: Its name in tables and figures.
        learn: Function that returns a predictor for a lesson.
        trains: Whether it trains a network, so that training options matter.
        needs_source: Whether it needs a source.
        needs_pairs: Whether it needs the source's prediction for each transition in the dataset.
        names: Whether it names effects.
    """

    label: str
    learn: Callable[[TrainingInput], TrainedPredictor]
    trains: bool = True
    needs_source: bool = False
    needs_pairs: bool = False
    names: bool = False


def find_kind(name: str) -> ModelKind:
    """Return a kind by its name.

    Raises:
        UnknownName: there is no such kind; lists those there are.
    """
    return registry.find_value(FOLDER, name, "kind", ModelKind)
