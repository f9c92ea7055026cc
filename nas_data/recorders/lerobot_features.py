"""Features of an imported LeRobot dataset beside joints and commands: vectors, pass-through data, what is left out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.descriptions import describe_left_out
from nas_data.dataset.features import ACTION, ENVIRONMENT, NEXT_STATE, SIM_STATE, STATE, TIME
from nas_data.dataset.joints import are_generated
from nas_data.dataset.merge import merge_passthrough
from nas_data.dataset.passthrough import VIDEO_LEFT_OUT, PassthroughFeatures, shared_features
from nas_data.dataset.read import read
from nas_data.dataset.recording import Recording
from nas_data.dataset.versions import resolve
from nas_data.importing.map import Map
from nas_data.importing.reading import SUFFIXES


def add_other_features(
    dataset: Dataset, recordings: Sequence[Recording], mapping: Map
) -> tuple[Dataset, Sequence[AuditFinding]]:
    """Add the other features of LeRobot datasets: vectors, and passed-through data such as videos.

    Returns:
        The dataset, and a finding on each passed-through feature that is left out.
    """
    sources = {file: read(resolve(Path(file))) for file in dict.fromkeys(recording.file for recording in recordings)}
    first, *others = sources.values()
    used = {STATE, ACTION, NEXT_STATE, SIM_STATE, TIME, *dataset.features}
    used |= {name for signal in mapping.signals.values() for name in signal.source.columns}
    shared = [key for key in first.features if all(key in other.features for other in others) and key not in used]
    for key in shared:
        rows = [sources[recording.file].columns[key][recording.rows[:-1]] for recording in recordings]
        dataset = dataset.with_column(key, first.features[key], np.concatenate(rows))
        if key == ENVIRONMENT:
            rows = [sources[recording.file].columns[key][recording.rows[1:]] for recording in recordings]
            dataset = dataset.with_column(f"next.{key}", first.features[key], np.concatenate(rows))
    if mapping.task == "{task}" and not mapping.resample:
        frame_tasks = [sources[recording.file].task_of_frame[recording.rows[:-1]] for recording in recordings]
        dataset = replace(dataset, frame_tasks=np.concatenate(frame_tasks))
    passthrough = [
        source.passthrough
        and source.passthrough.take(np.concatenate([r.rows[:-1] for r in recordings if r.file == file]))
        for file, source in sources.items()
    ]
    kept = None if mapping.resample else merge_passthrough(passthrough)
    if kept is not None and mapping.fps != first.fps:
        kept = kept.without_videos()
    lost = [*_report_lost(recordings, passthrough, kept, mapping), *_report_unused(first, recordings[0].file, mapping)]
    return replace(dataset, passthrough=kept), lost


def _report_unused(source: Dataset, file: str, mapping: Map) -> list[AuditFinding]:
    """Return a finding on the components of state and action that belong to no joint of the map."""
    ends = tuple(SUFFIXES.values())
    named = {*mapping.joints}
    places: dict[str, set[int]] = {}
    for quantity in filter(None, (mapping.position, mapping.velocity, mapping.command, *mapping.signals.values())):
        named |= {*quantity.source.names}
        for key in quantity.source.columns:
            places.setdefault(key, set()).update(quantity.source.components)
    unused = {
        key: [
            name
            for index, name in enumerate(source.features[key].names)
            if index not in places.get(key, ()) and not {name, _remove_suffix(name, ends)} & named
        ]
        for key in (STATE, ACTION)
        if key in source.features and not are_generated(key, source.features[key].names)
    }
    parts = [f"{', '.join(names)} of {key}" for key, names in unused.items() if names]
    what = f"left out: {' and '.join(parts)}, because the map names no such joint"
    return [AuditFinding("left_out", file, what, minor=True)] if parts else []


def _remove_suffix(name: str, ends: Sequence[str]) -> str:
    """Return the joint of a component's name."""
    return next((name.removesuffix(end) for end in ends if name.endswith(end)), name)


def _report_lost(
    recordings: Sequence[Recording],
    passthrough: Sequence[PassthroughFeatures | None],
    kept: PassthroughFeatures | None,
    mapping: Map,
) -> list[AuditFinding]:
    """Return a finding on the passed-through features that are left out, for each reason."""
    everything = {key: entry for part in passthrough if part for key, entry in part.features.items()}
    lost = {key: entry for key, entry in everything.items() if kept is None or key not in kept.features}
    shared = set(shared_features(passthrough))
    reasons = {
        "they belong to the rows that were recorded, which are resampled": lost if mapping.resample else {},
        "not every dataset has them, or not all store them alike": {} if mapping.resample else lost.keys() - shared,
        VIDEO_LEFT_OUT: {} if mapping.resample else lost.keys() & shared,
    }
    file = recordings[0].file
    sentences = [
        describe_left_out({key: lost[key] for key in lost if key in keys}, why) for why, keys in reasons.items() if keys
    ]
    return [AuditFinding("left_out", file, sentence) for sentence in sentences]
