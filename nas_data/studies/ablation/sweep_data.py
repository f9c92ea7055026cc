"""Input of a sweep: datasets, source and effects, with their location and content hashes."""

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.dataset.transitions import as_transitions
from nas_data.errors import DatasetInvalid, ModelFileError
from nas_data.gap.write_model import EFFECTS
from nas_data.sources import SourceModel, locate_source
from nas_data.studies.ablation.subsets import divide


@dataclass(frozen=True)
class Content:
    """Identity of the data, independent of the machine.

    Attributes:
        dataset: Content hash of the dataset.
        test: Content hash of the held-out dataset; None if episodes of the first one are held out.
        source: SHA-256 of the source's model, engine and effects; None without a source.
        effects: SHA-256 of the given named effects; None without.
    """

    dataset: str
    test: str | None
    source: str | None
    effects: str | None

    def to_json(self, named: bool = True) -> dict[str, str | None]:
        """Return the hashes for JSON; without effects for a trial that names none."""
        return asdict(self if named else replace(self, effects=None))


@dataclass(frozen=True)
class SweepData:
    """Location of the data of a sweep.

    Attributes:
        root: Folder of the dataset.
        test: Folder of the held-out dataset; None if episodes of the first one are held out.
        model: Source model; None for the one kept with the dataset.
        engine: Engine of the source; None for the one of the pairing.
        effects: Folder of a gap report, or its effects.json, to use instead of naming.
    """

    root: Path
    test: Path | None = None
    model: str | None = None
    engine: str | None = None
    effects: Path | None = None

    def read(self) -> Dataset:
        """Read the dataset as transitions."""
        return as_transitions(read(self.root))[0]

    def source(self) -> SourceModel | None:
        """Return the source; None if none is given and the dataset keeps none."""
        try:
            return locate_source(self.model, (), [self.root], self.engine)
        except ModelFileError:
            if self.model is not None:
                raise
            return None

    def divide(self, dataset: Dataset, share: float | None, seed: int) -> tuple[list[int], Dataset]:
        """Return the training episodes, and the held-out data: the test dataset, or a share of the episodes."""
        if self.test is not None:
            return list(range(dataset.n_episodes)), as_transitions(read(self.test))[0]
        assert share is not None
        train, held = divide(dataset.n_episodes, share, seed)
        return train, dataset.select(held)

    def content(self) -> Content:
        """Return the identity of the present data."""
        return Content(
            dataset=hash_content(read(self.root)),
            test=None if self.test is None else hash_content(read(self.test)),
            source=self._hash_source(),
            effects=None if self.effects is None else hash_effects_file(self.effects),
        )

    def _hash_source(self) -> str | None:
        source = self.source()
        if source is None:
            return None
        described = source.simulator(self.read(), threads=1).describe()
        told = [str(described.get(key)) for key in ("sha256", "engine", "effects")]
        return hashlib.sha256("\n".join(told).encode()).hexdigest()

    def check(self, content: Content) -> None:
        """Raise DatasetInvalid if the data changed since a sweep began."""
        changed = [key for key, value in self.content().to_json().items() if value != content.to_json()[key]]
        if changed:
            raise DatasetInvalid(
                f"The {changed[0]} of the sweep on {self.root} changed while it ran; start it anew with another --out."
            )


def hash_effects_file(path: Path) -> str:
    """Return the SHA-256 of an effects file, or of the one in a gap report."""
    file = path / EFFECTS if path.is_dir() else path
    return hashlib.sha256(file.read_bytes()).hexdigest()
