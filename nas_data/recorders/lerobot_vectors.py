"""Components of vectors of LeRobot datasets, by name: which of them a map reads, and which several datasets share."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import Feature, are_generated
from nas_data.dataset.merge import describe_difference
from nas_data.errors import DatasetInvalid
from nas_data.importing.map import LogQuantity, Map
from nas_data.importing.reading import match_components

LEAVE_OUT = "leave it out with LeRobot's 'lerobot-edit-dataset --operation.type=remove_feature'"


def join_vectors(key: str, sources: Mapping[str, Dataset]) -> tuple[Feature, dict[str, np.ndarray]]:
    """Return the common feature of a key that all datasets have, and the column of each in the order of its names.

    The common type of number holds the numbers of all.

    Args:
        key: Key of the feature.
        sources: The datasets by their path.

    Raises:
        DatasetInvalid: the datasets name other components or units.
    """
    first, *others = sources
    common, columns = sources[first].features[key], {first: sources[first].columns[key]}
    for file in others:
        feature, columns[file] = _arrange(sources[file], key, common.names)
        if (feature.names, feature.units) != (common.names, common.units):
            raise DatasetInvalid(
                f"'{key}' {describe_difference(common, feature, first, file)}; import them one at a time, or "
                f"{LEAVE_OUT}."
            )
    dtype = np.result_type(*(sources[file].features[key].dtype for file in sources))
    return replace(common, dtype=dtype.name), columns


def check_signals(sources: Mapping[str, Dataset], mapping: Map) -> None:
    """Refuse datasets that name what a signal reads differently.

    Raises:
        DatasetInvalid: the components that a signal reads have other names or units in one dataset than in another.
    """
    for signal in mapping.signals.values():
        for key in signal.source.columns:
            owners = {file: source.features[key] for file, source in sources.items() if key in source.features}
            parts = {
                file: _select(key, feature, find_places(file, signal, feature.names, mapping.joints))
                for file, feature in owners.items()
            }
            first, *others = parts or [""]
            for file in others:
                here, there = _fill(parts[first], parts[file]), _fill(parts[file], parts[first])
                if here != there:
                    raise DatasetInvalid(
                        f"'{key}' {describe_difference(here, there, first, file)}, but [signals.{signal.name}] reads "
                        "both alike; import them one at a time, each with its own map."
                    )


def find_places(file: str, quantity: LogQuantity, names: Sequence[str], joints: Sequence[str]) -> tuple[int, ...]:
    """Return the components of a column that a quantity reads, by their places.

    Args:
        file: The dataset.
        quantity: The quantity.
        names: Names of the column's components.
        joints: The map's joints.
    """
    columns = quantity.source
    if len(columns.columns) == 1 and len(quantity.conversion.gain) == len(joints):
        columns = match_components(Path(file), quantity, columns, joints, names)
    return columns.components or tuple(range(len(names)))


def _arrange(dataset: Dataset, key: str, names: tuple[str, ...]) -> tuple[Feature, np.ndarray]:
    """Return a feature and its column in the order of some names; unchanged if it has not exactly these."""
    feature, column = dataset.features[key], dataset.columns[key]
    if len(set(names)) < len(names) or sorted(names) != sorted(feature.names):
        return feature, column
    places = [feature.names.index(name) for name in names]
    units = tuple(feature.units[place] for place in places if feature.units)
    return replace(feature, names=names, units=units), column[:, places]


def _select(key: str, feature: Feature, places: Sequence[int]) -> Feature:
    """Return some components of a feature; names that are generated, or of a single component, tell nothing."""
    told = len(places) > 1 and not are_generated(key, feature.names)
    names = tuple(feature.names[place] for place in places if told)
    return Feature(names, tuple(feature.units[place] for place in places if feature.units))


def _fill(feature: Feature, other: Feature) -> Feature:
    """Return a feature with the names and units of another in place of missing ones."""
    return Feature(feature.names or other.names, feature.units or other.units)
