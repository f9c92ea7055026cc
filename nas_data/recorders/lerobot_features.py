"""Features of an imported LeRobot dataset beside joints and commands: vectors, pass-through data, what is left out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.descriptions import describe_left_out
from nas_data.dataset.features import ACTION, ENVIRONMENT, NEXT_STATE, SIM_STATE, STATE, TIME
from nas_data.dataset.merge import merge_passthrough
from nas_data.dataset.passthrough import VIDEO_LEFT_OUT, PassthroughFeatures, shared_features
from nas_data.dataset.read import read
from nas_data.dataset.recording import Recording
from nas_data.dataset.versions import resolve
from nas_data.importing.map import Map
from nas_data.recorders.lerobot_vectors import check_signals, find_places, join_vectors

ONLY_SOME = "not every dataset has them"


def add_other_features(
    dataset: Dataset, recordings: Sequence[Recording], mapping: Map
) -> tuple[Dataset, Sequence[AuditFinding]]:
    """Add the other features of LeRobot datasets: vectors, and passed-through data such as videos.

    Returns:
        The dataset, and findings on the features and components that are left out.

    Raises:
        DatasetInvalid: a vector has other components or units in one dataset than in another.
    """
    sources = {file: read(resolve(Path(file))) for file in dict.fromkeys(recording.file for recording in recordings)}
    check_signals(sources, mapping)
    first = next(iter(sources.values()))
    used = {STATE, ACTION, NEXT_STATE, SIM_STATE, TIME}
    used |= {name for signal in mapping.signals.values() for name in signal.source.columns}
    vectors = dict.fromkeys(key for source in sources.values() for key in source.features if key not in used)
    partial = [key for key in vectors if not all(key in source.features for source in sources.values())]
    replaced = [key for key in vectors if key in dataset.features]
    for key in (key for key in vectors if key not in {*partial, *replaced}):
        feature, columns = join_vectors(key, sources)
        rows = [columns[recording.file][recording.rows[:-1]] for recording in recordings]
        dataset = dataset.with_column(key, feature, np.concatenate(rows))
        if key == ENVIRONMENT:
            rows = [columns[recording.file][recording.rows[1:]] for recording in recordings]
            dataset = dataset.with_column(f"next.{key}", feature, np.concatenate(rows))
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
    lost = [
        *_report_vectors(sources, [key for key in partial if key not in replaced], ONLY_SOME),
        *_report_vectors(sources, replaced, "the map gives other values for them"),
        *_report_lost(recordings, passthrough, kept, mapping),
        *_report_unused(sources, mapping),
    ]
    return replace(dataset, passthrough=kept), lost


def _report_vectors(sources: Mapping[str, Dataset], keys: Sequence[str], why: str) -> list[AuditFinding]:
    """Return a finding on vectors that are left out."""
    found = {key: next(source.features[key] for source in sources.values() if key in source.features) for key in keys}
    described = {key: feature.to_info() for key, feature in found.items()}
    return [AuditFinding("left_out", next(iter(sources)), describe_left_out(described, why))] if keys else []


def _report_unused(sources: Mapping[str, Dataset], mapping: Map) -> list[AuditFinding]:
    """Return findings on the components of state, action and signals that the map does not read; equal ones once."""
    keys = dict.fromkeys([STATE, ACTION, *(key for one in mapping.signals.values() for key in one.source.columns)])
    files: dict[str, str] = {}
    for file, source in sources.items():
        unused = {key: _list_unread(file, source, key, mapping) for key in keys if key in source.features}
        parts = [f"{', '.join(names)} of {key}" for key, names in unused.items() if names]
        if parts:
            files.setdefault(f"left out: {' and '.join(parts)}, because the map reads no such component", file)
    return [AuditFinding("left_out", file, what, minor=True) for what, file in files.items()]


def _list_unread(file: str, source: Dataset, key: str, mapping: Map) -> list[str]:
    """Return the names of the components of a feature that no quantity of the map reads."""
    names = source.features[key].names
    readers = [quantity for quantity in mapping.quantities if key in quantity.source.columns]
    places = {place for quantity in readers for place in find_places(file, quantity, names, mapping.joints)}
    return [name for place, name in enumerate(names) if place not in places]


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
        f"{ONLY_SOME}, or not all store them alike": {} if mapping.resample else lost.keys() - shared,
        VIDEO_LEFT_OUT: {} if mapping.resample else lost.keys() & shared,
    }
    file = recordings[0].file
    sentences = [
        describe_left_out({key: lost[key] for key in lost if key in keys}, why) for why, keys in reasons.items() if keys
    ]
    return [AuditFinding("left_out", file, sentence) for sentence in sentences]
