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
    from nas_data.studies.ablation.kinds.named import NamedSource  # kinds that only train must not depend on the search

FOLDER = "studies.ablation.kinds"


@dataclass(frozen=True)
class TrainingInput:
    """Input of a kind."""

    data: Dataset  # transitions of the subset
    root: Path  # folder of their dataset, for names and error messages
    source: SourceModel | None  # plain source; None if there is none
    effects: Path | None  # a gap report's folder, or its effects.json, to use instead of naming
    options: TrainingOptions  # options of the training, seed included
    folder: Path  # empty folder for working files

    @property
    def plain(self) -> SourceModel:
        """The plain source, for kinds that need one."""
        assert self.source is not None  # checked before any training
        return self.source


@dataclass(frozen=True)
class TrainedPredictor:
    """A predictor."""

    model: DynamicsModel | None  # φ or ψ; None if the source predicts alone
    source: SourceModel | None  # its source; None for ψ
    named: "NamedSource | None" = None  # named effects, if any


@dataclass(frozen=True)
class ModelKind:
    """A kind; the file `ablation/kinds/a_b.py` holds the kind `a_b` as `KIND`."""

    label: str  # its name in tables and figures
    learn: Callable[[TrainingInput], TrainedPredictor]  # returns a predictor for an input
    trains: bool = True  # whether it trains a network, so that training options matter
    needs_source: bool = False  # whether it needs a source
    needs_pairs: bool = False  # whether it needs the source's prediction for each transition in the dataset
    names: bool = False  # whether it names effects


def find_kind(name: str) -> ModelKind:
    """Return a kind by its name.

    Raises:
        UnknownName: there is no such kind; lists the kinds.
    """
    return registry.find_value(FOLDER, name, "kind", ModelKind)
