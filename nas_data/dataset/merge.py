"""Merge of several datasets of one robot; episodes keep the given order."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nas_data.arrays import Array
from nas_data.count_of import count_of
from nas_data.dataset import layout
from nas_data.dataset.content import hash_episodes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import Derived, Original, find_common_value, inherit
from nas_data.dataset.descriptions import describe_kind, find_difference
from nas_data.dataset.features import NEXT_STATE, SIM_ENVIRONMENT, SIM_STATE, STATE, Feature
from nas_data.dataset.joints import list_joints
from nas_data.dataset.passthrough import PassthroughFeatures, shared_features
from nas_data.errors import DatasetInvalid, JointMismatch

LEAVE_OUT = "to leave a camera out, use LeRobot's 'lerobot-edit-dataset --operation.type=remove_feature'"

FLOATS = {"float32", "float64"}  # the import chooses one by a signal's values


def merge(originals: Sequence[Original]) -> Derived:
    """Merge datasets with equal joints, features, rate and robot type.

    A feature that is float32 in one dataset and float64 in another becomes float64.
    The source's predictions are left out if a dataset has none; they can be computed again.

    Args:
        originals: The datasets, at least one.

    Raises:
        JointMismatch: two datasets have different joints.
        DatasetInvalid: they differ in a feature, the rate or the robot type.
    """
    parts = drop_partial_predictions(originals)
    for other in parts[1:]:
        check_mergeable(parts[0], other)
    names = ", ".join(original.parent.name for original in originals)
    files = [original.attachments for original in originals]
    return Derived(
        dataset=concatenate([part.dataset for part in parts]),
        provenance=inherit(originals, f"merged from {names}"),
        attachments={
            key: content for key, content in files[0].items() if all(item.get(key) == content for item in files)
        },
    )


def drop_partial_predictions(originals: Sequence[Original]) -> list[Original]:
    """Return the datasets without the source's predictions that one of them lacks."""
    partial = {
        key
        for key in (SIM_STATE, SIM_ENVIRONMENT)
        if not all(key in original.dataset.features for original in originals)
    }
    return [replace(original, dataset=original.dataset.without_columns(partial)) for original in originals]


def concatenate(datasets: Sequence[Dataset]) -> Dataset:
    """Concatenate the episodes of datasets with equal features, whose dtypes may be float32 and float64."""
    first = datasets[0]
    features = {
        key: replace(feature, dtype=np.result_type(*(dataset.features[key].dtype for dataset in datasets)).name)
        for key, feature in first.features.items()
    }
    return Dataset(
        features=features,
        columns={key: np.concatenate([dataset.columns[key] for dataset in datasets]) for key in features},
        lengths=np.concatenate([dataset.lengths for dataset in datasets]),
        fps=first.fps,
        robot_type=first.robot_type,
        tasks=tuple(task for dataset in datasets for task in dataset.tasks),
        passthrough=merge_passthrough([dataset.passthrough for dataset in datasets]),
        frame_tasks=merge_frame_tasks(datasets),
    )


def merge_passthrough(passthrough: Sequence[PassthroughFeatures | None]) -> PassthroughFeatures | None:
    """Concatenate the pass-through features that datasets have in common; None if there are none."""
    parts = [part for part in passthrough if part is not None]
    if not parts or len(parts) < len(passthrough):
        return None
    frames = [sum(part.frames) for part in parts]
    offsets = np.cumsum([0, *frames[:-1]])
    return PassthroughFeatures(
        tuple(root for part in parts for root in part.roots),
        np.concatenate([part.rows + offset for part, offset in zip(parts, offsets, strict=True)]),
        kept=tuple(shared_features(passthrough)),
    )


def merge_frame_tasks(datasets: Sequence[Dataset]) -> Array | None:
    """Concatenate the tasks of frames; None if no episode has several."""
    if all(dataset.frame_tasks is None for dataset in datasets):
        return None
    return np.concatenate([dataset.task_of_frame for dataset in datasets])


def list_merge_warnings(originals: Sequence[Original]) -> Iterator[str]:
    """Yield warnings about a merge, one sentence each."""
    for original in originals:
        yield from original.remarks()
    parts = drop_partial_predictions(originals)
    kept = parts[0].dataset.features
    unpaired = [original.root for original in originals if not original.dataset.paired]
    if SIM_STATE not in kept and len(unpaired) < len(originals):
        yield f"'{SIM_STATE}' is left out, because {unpaired[0]} lacks it: pair the merged dataset (nas pair)."
    elif (
        SIM_STATE in kept
        and find_common_value([original.provenance and original.provenance.source for original in originals]) is None
    ):
        yield f"'{SIM_STATE}' comes from no single known source: pair the merged dataset again (nas pair)."
    if len({original.attachments.get(layout.SUBTASKS) for original in originals}) > 1:
        yield f"{layout.SUBTASKS} is left out, because it is not the same in all; 'subtask_index' keeps its numbers."
    hashes = [found for part in parts for found in hash_episodes(part.dataset, sorted(kept))]
    repeated = len(hashes) - len(set(hashes))
    if repeated:
        yield (
            f"It holds {count_of(repeated, 'episode')} more than once: a split may put copies of an episode into "
            "both parts."
        )


def check_mergeable(a: Original, b: Original) -> None:
    """Refuse two datasets that cannot be merged.

    Raises:
        JointMismatch: other joints.
        DatasetInvalid: other features, rate or robot type.
    """
    _check_joints(a, b)
    if a.dataset.fps != b.dataset.fps:
        raise DatasetInvalid(
            f"{b.root} runs at {b.dataset.fps:g} Hz, {a.root} at {a.dataset.fps:g} Hz; "
            "record or import them at one rate to merge them."
        )
    if a.dataset.robot_type != b.dataset.robot_type:
        raise DatasetInvalid(
            f"{b.root} is of the robot '{b.dataset.robot_type}', {a.root} of '{a.dataset.robot_type}'; "
            "only datasets of one robot are merged; if it is the same one, import both with the same 'robot' in the "
            "map."
        )
    _check_features(a, b)


def _check_joints(a: Original, b: Original) -> None:
    if STATE not in a.dataset.features or STATE not in b.dataset.features:
        return
    ours, theirs = (list_joints(original.dataset.features[STATE]) for original in (a, b))
    if set(ours) != set(theirs):
        raise JointMismatch(
            f"{b.root} has the joints {', '.join(theirs) or 'without names'}, {a.root} has "
            f"{', '.join(ours) or 'joints without names'}; only datasets of the same joints are merged; "
            "if only their names differ, import both with the same 'joints' in the map."
        )


def _check_features(a: Original, b: Original) -> None:
    passthrough = [original.dataset.passthrough.features if original.dataset.passthrough else {} for original in (a, b)]
    for key in {**passthrough[0], **passthrough[1]}:
        if key not in passthrough[0] or key not in passthrough[1]:
            poor, rich = (a, b) if key not in passthrough[0] else (b, a)
            raise DatasetInvalid(
                f"{poor.root} lacks '{key}' ({describe_kind(passthrough[rich is b][key])}), which {rich.root} has; "
                f"only datasets with the same cameras and texts are merged; {LEAVE_OUT}."
            )
        unlike = find_difference(passthrough[0][key], passthrough[1][key])
        if unlike is not None:
            what, here, there = unlike
            raise DatasetInvalid(
                f"'{key}' has {what} {there} in {b.root} and {here} in {a.root}, so that the same stored values mean "
                f"different things; only datasets with the same cameras and texts are merged; {LEAVE_OUT}."
            )
    for poor, rich in ((a, b), (b, a)):
        missing = [key for key in rich.dataset.features if key not in poor.dataset.features]
        if missing:
            remedy = (
                "pair both with the same model (nas pair)"
                if NEXT_STATE in missing  # pairing derives it where LeRobot recorded
                else "record or import both in the same way"
            )
            raise DatasetInvalid(f"{poor.root} lacks '{missing[0]}', which {rich.root} has; {remedy} to merge them.")
    for key, feature in a.dataset.features.items():
        other = b.dataset.features[key]
        if {feature.dtype, other.dtype} == FLOATS:
            other = replace(other, dtype=feature.dtype)
        if feature != other:
            raise DatasetInvalid(
                f"'{key}' {describe_difference(feature, other, a.root, b.root)}; record or import both in the same "
                "way to merge "
                "them."
            )


def describe_difference(a: Feature, b: Feature, where_a: Path | str, where_b: Path | str) -> str:
    """Return a phrase on how two features of one key differ."""
    what = next(what for what in ("names", "units", "dtype") if getattr(a, what) != getattr(b, what))
    here, there = _format_names(getattr(a, what)), _format_names(getattr(b, what))
    return f"has {what} {here} in {where_a} and {there} in {where_b}"


def _format_names(value: str | tuple[str, ...]) -> str:
    return value if isinstance(value, str) else ", ".join(dict.fromkeys(value)) or "not stored"
