"""Summary of a dataset for `nas info`."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.dataset.content import choose_content_hash, has_content_hash
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import audit_external
from nas_data.dataset.features import ACTION, EFFORT, POSITION, STATE, VELOCITY, Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.provenance import Parent, Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.versions import find_dataset_name, resolve
from nas_data.errors import DatasetInvalid, JointMismatch

KINDS = {POSITION: "position", VELOCITY: "velocity", EFFORT: "torque"}
LONGEST_CHAIN = 100  # generations; ends a cyclic chain


@dataclass(frozen=True)
class DatasetSummary:
    """Summary of a dataset.

    Attributes:
        dataset: Its folder.
        name: Its name and version.
        robot: Robot's name.
        joints: Joints with a measured position; empty if the dataset is not usable.
        commands: `position`, `velocity` or `torque`, joined if joints differ; empty if the dataset is not usable.
        rate: Control rate [Hz].
        lengths: Frames of each episode.
        tasks: Task → number of episodes.
        features: Features that are read.
        carried: Pass-through features (images, strings …) with their types.
        ranges: State and action: component → smallest and largest value, in the feature's unit.
        units: Unit of each component of state and action, by its name.
        derived: Features that are derived for use: feature → how.
        unusable: Why it cannot be converted to transitions; None if it can.
        warnings: Warnings of the audits, if another tool recorded it.
        paired: Whether the source's predictions are present.
        source: The source model; None if the provenance names none.
        content_hash: SHA-256 of the content.
        provenance: Its own provenance, then its parent's, and so on, as far as the versions are present.
    """

    dataset: Path
    name: str
    robot: str
    joints: tuple[str, ...]
    commands: str
    rate: float
    lengths: tuple[int, ...]
    tasks: Mapping[str, int]
    features: Mapping[str, Feature]
    carried: Mapping[str, str]
    ranges: Mapping[str, Mapping[str, tuple[float, float]]]
    units: Mapping[str, str]
    derived: Mapping[str, str]
    unusable: str | None
    warnings: tuple[str, ...]
    paired: bool
    source: Mapping[str, object] | None
    content_hash: str
    provenance: tuple[tuple[str, Provenance], ...]

    def to_json(self) -> dict[str, object]:
        """Return the summary for JSON; sizes in frames, duration in seconds."""
        features = {
            key: {"names": item.names, "units": item.units, "dtype": item.dtype} for key, item in self.features.items()
        }
        chain = [{"name": name, **provenance.to_json()} for name, provenance in self.provenance]
        sizes = {
            "episodes": len(self.lengths),
            "frames": sum(self.lengths),
            "duration": sum(self.lengths) / self.rate,
        }
        return {**vars(self), **sizes, "features": features, "provenance": chain}


def summarize(path: Path) -> DatasetSummary:
    """Read and summarise a dataset.

    Raises:
        DatasetNotFound: there is no dataset at the path.
        DatasetInvalid: it cannot be read.
    """
    root = resolve(path)
    dataset = read(root)
    chain, stored = trace_provenance(root), read_provenance(root)
    usable, derived, reason, noticed = _derive_transitions(root, dataset)
    shown = usable or dataset
    return DatasetSummary(
        dataset=root,
        name=find_dataset_name(root),
        robot=dataset.robot_type,
        joints=usable.joints if usable else (),
        commands="" if usable is None else " and ".join(dict.fromkeys(map(KINDS.__getitem__, usable.kinds))),
        rate=dataset.fps,
        lengths=tuple(dataset.lengths.tolist()),
        tasks={task: dataset.tasks.count(task) for task in dict.fromkeys(dataset.tasks)},
        features=dataset.features,
        carried=DatasetInfo.read(root).other_features,
        ranges={key: _compute_ranges(shown, key) for key in (STATE, ACTION) if key in shown.features},
        units={name: unit for key in (ACTION, STATE) for name, unit in _list_units(shown, key).items()},
        derived=derived,
        unusable=reason,
        warnings=noticed,
        paired=dataset.paired,
        source=chain[0][1].source if chain else None,
        content_hash=choose_content_hash(dataset, stored.content_hash if stored else ""),
        provenance=chain,
    )


def describe_source(source: Mapping[str, object] | None) -> str:
    """Return name, engine and hash of a source as text; empty if none is known."""
    known = source or {}
    engine = " ".join(str(known[key]) for key in ("engine", "engine_version") if key in known)
    digest = f"SHA-256 {known['sha256']}" if "sha256" in known else ""
    return ", ".join(filter(None, (str(known.get("name", "")), engine, digest)))


def trace_provenance(root: Path) -> tuple[tuple[str, Provenance], ...]:
    """Return the provenance of a dataset, of its first parent, and so on, each with its name.

    Parents are looked up as versions below the same `datasets/` folder.
    """
    chain: list[tuple[str, Provenance]] = []
    name, here = find_dataset_name(root), root.resolve()
    provenance = read_provenance(here)
    while provenance is not None and len(chain) < LONGEST_CHAIN:
        chain.append((name, provenance))
        if not provenance.parents:
            break
        parent = provenance.parents[0]
        name, here = parent.name, here.parent.parent / parent.name
        provenance = read_provenance(here)
        if provenance is not None and not _is_parent(here, provenance, parent):
            break  # another dataset of the same name
    return tuple(chain)


def _is_parent(root: Path, provenance: Provenance, parent: Parent) -> bool:
    """Whether a dataset is the one that a child names, whose entry may have its hash by the rule of another version."""
    if provenance.content_hash == parent.content_hash:
        return True
    try:
        return has_content_hash(read(root), parent.content_hash)
    except DatasetInvalid:
        return False


def _derive_transitions(
    root: Path, dataset: Dataset
) -> tuple[Dataset | None, dict[str, str], str | None, tuple[str, ...]]:
    """Return the dataset as transitions, derived features, the reason if it is unusable, and warnings."""
    try:
        usable, derived, noticed = audit_external(root, dataset)
    except (DatasetInvalid, JointMismatch) as error:
        return None, {}, str(error), ()
    return usable, derived, None, noticed


def _list_units(dataset: Dataset, key: str) -> dict[str, str]:
    """Return the unit of each component; empty if the units are unknown."""
    feature = dataset.features.get(key)
    return dict(zip(feature.names, feature.units, strict=True)) if feature and feature.units else {}


def _compute_ranges(dataset: Dataset, key: str) -> dict[str, tuple[float, float]]:
    """Return the smallest and largest value of each component."""
    low, high = np.min(dataset.columns[key], axis=0).tolist(), np.max(dataset.columns[key], axis=0).tolist()
    return dict(zip(dataset.features[key].names, zip(low, high, strict=True), strict=True))
