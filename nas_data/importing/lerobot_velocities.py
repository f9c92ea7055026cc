"""Velocities of LeRobot datasets whose states hold them beside the positions."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset import audits
from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.features import POSITION, STATE, VELOCITY, Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.recording import Recording
from nas_data.dataset.versions import resolve
from nas_data.importing.auditing import make_expected
from nas_data.importing.conversion import SI, Kind
from nas_data.importing.map import KEPT_VELOCITY, LogColumns, LogQuantity, Map
from nas_data.importing.reading import match_components, read_log

GENERATED = "generated"  # name of a map that was made for a dataset
LARGEST_RATIO = 20.0  # of distances by velocities and by positions in one unit; degrees and radians differ by 57
READ_VELOCITY = re.compile(r"^\[read\.velocity[.\]].*\n(?:(?!\[).*\n)*", re.MULTILINE)  # tables of a generated map


def read_datasets(paths: Sequence[Path], mapping: Map) -> tuple[list[Recording], list[AuditFinding]]:
    """Read several datasets as one."""
    read_each = [read_log(path, mapping) for path in paths]
    return [part for parts, _ in read_each for part in parts], [one for _, found in read_each for one in found]


def derive_missing_velocity(mapping: Map, paths: Sequence[Path], unit: str | None) -> tuple[Map, tuple[str, ...]]:
    """Derive the velocities of a generated map if the states of a dataset lack those of a joint.

    The map was made for the first dataset. Without this, the order of the datasets would decide whether they can be
    imported together.

    Args:
        mapping: The map.
        paths: The datasets.
        unit: Unit of the positions, as `ImportOptions.unit`.

    Returns:
        The map, and a note if velocities are derived.
    """
    if mapping.name != GENERATED or mapping.velocity is None:
        return mapping, ()
    wanted = [joint + VELOCITY for joint in mapping.joints]
    for path in paths:
        features = DatasetInfo.read(resolve(path)).features
        if STATE not in features:
            continue  # refused where positions are read
        state = Feature.from_info(STATE, features[STATE])
        units = dict(zip(state.names, state.units or [""] * len(state.names), strict=True))
        if all(units.get(name) in ("", f"{unit}/s") for name in wanted):
            continue
        text = READ_VELOCITY.sub("", mapping.text).replace('velocity = "measured"', 'velocity = "derive"', 1)
        note = f"Velocities are derived, because the states of {path} do not hold all in the positions' unit."
        return replace(mapping, velocity=None, derive_velocity=True, text=text), (note,)
    return mapping, ()


def complete_velocity(mapping: Map, notes: tuple[str, ...], paths: Sequence[Path]) -> tuple[Map, tuple[str, ...]]:
    """Complete a map with the velocities that the states hold beside the positions, in the unit of the positions.

    A generated map takes them as measured velocities, unless they contradict the positions. Where velocities are
    derived, the recorded ones are kept as a signal.
    """
    recorded = _find_velocity(mapping, paths)
    if recorded is None:
        return mapping, notes
    if mapping.name == GENERATED and mapping.velocity is not None:
        mapping = replace(mapping, velocity=recorded)
        if not _contradicts_positions(mapping, paths):
            return mapping, notes
        text = mapping.text.replace('velocity = "measured"', 'velocity = "derive"', 1)
        kept = f"these are nas.{KEPT_VELOCITY}"
        note = f"Velocities are derived, because the recorded ones contradict the positions; {kept}."
        return replace(mapping, derive_velocity=True, text=text), (*notes, note)
    if mapping.derive_velocity and mapping.velocity is None and KEPT_VELOCITY not in mapping.signals:
        return replace(mapping, velocity=recorded), notes
    return mapping, notes


def _find_velocity(mapping: Map, paths: Sequence[Path]) -> LogQuantity | None:
    """Return the velocities of all joints that the states of all datasets hold beside the positions.

    Returns:
        The quantity, in the unit of the positions per second; None if a velocity is missing, if one is stored in
        another unit, or if a dataset holds them in a feature of their own.
    """
    position = mapping.position
    raw, names = position.conversion.units, set[tuple[str, ...]]()
    kind: Kind = "velocity"
    for path in paths:
        features = DatasetInfo.read(resolve(path)).features
        if position.source.columns != (STATE,) or STATE not in features or f"nas.{KEPT_VELOCITY}" in features:
            return None
        state = Feature.from_info(STATE, features[STATE])
        places = match_components(path, position, position.source, mapping.joints, state.names).components
        wanted = tuple(state.names[place].removesuffix(POSITION) + VELOCITY for place in places)
        if not wanted or not set(wanted) <= set(state.names):
            return None
        units = [state.units[state.names.index(name)] if state.units else "" for name in wanted]
        if any(unit not in ("", f"{held}/s") for unit, held in zip(units, raw, strict=True)):
            return None
        names.add(wanted)
    if len(names) > 1:
        return None
    conversion = replace(
        position.conversion,
        bias=(0.0,) * len(raw),
        units=tuple(f"{unit}/s" for unit in raw),
        kinds=(kind,) * len(raw),
    )
    return LogQuantity(kind, SI[kind], LogColumns((STATE,), names=names.pop()), conversion)


def _contradicts_positions(mapping: Map, paths: Sequence[Path]) -> bool:
    """Whether the measured velocities have another scale or sign than the positions."""
    expected = make_expected(mapping)
    recordings, _ = read_datasets(paths, mapping)
    sound = [part for part in recordings if not any(one.error for one in audits.run(audits.FIRST, part, expected))]
    if any(one.error for part in sound for one in audits.run(["velocity"], part, expected)):
        return True
    # The audit needs steady motion. In jerky motion, the distances that positions and velocities cover show the unit.
    measured, claimed, shortest = 0.0, 0.0, 0.0
    for part in sound:
        assert part.velocities is not None
        measured += float(np.abs(np.diff(part.positions, axis=0)).sum())
        claimed += float((np.abs(part.velocities[:-1]) * np.diff(part.time)[:, None]).sum())
        shortest += float(np.ptp(part.positions, axis=0).sum())
    return claimed > LARGEST_RATIO * measured or claimed < shortest / LARGEST_RATIO
