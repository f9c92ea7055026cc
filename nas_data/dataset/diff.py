"""Comparison of two datasets: features, rate, robot, episodes matched by content, values, provenance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from nas_data.dataset.content import convert_column, hash_content, hash_episodes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import STATE, TIME, Feature
from nas_data.dataset.joints import list_joints
from nas_data.dataset.provenance import Provenance

COMPARED = ("how", "robot", "source", "target", "signal", "seeds", "parents", "derived", "contiguous", "notes")


@dataclass(frozen=True)
class Change:
    """Difference of one feature's values in the compared episodes.

    Attributes:
        largest: Largest absolute difference, in the feature's unit.
        unit: That unit; empty if none is stored.
        component: Component with the largest difference.
        episodes: Its episodes in A and in B.
        frame: Its frame within the episode.
        frames: Number of frames that differ in any bit.
    """

    largest: float
    unit: str
    component: str
    episodes: tuple[int, int]
    frame: int
    frames: int


@dataclass(frozen=True)
class Difference:
    """Differences between two datasets A and B; a pair is (in A, in B).

    Attributes:
        content_hashes: Content hashes.
        only: Features in only one dataset.
        changed: Features in both with different descriptions: key → descriptions.
        joints: Joints in only one dataset.
        rates: Rates [Hz], if they differ.
        robots: Robot types, if they differ.
        counts: Numbers of episodes.
        equal_episodes: Number of episodes in both that are bit-identical in the shared features.
        moved: Number of those with another index.
        compared: Episodes of equal length that were compared value by value.
        unmatched: Episodes in only one dataset.
        values: Feature → difference of its values in the compared episodes.
        tasks: Episodes with different tasks: (episode in A, in B, task in A, in B).
        frame_tasks: Episodes with the same tasks in other frames: (episode in A, in B, frames that differ, first one).
        provenance: Differences in provenance; they do not count as content.
    """

    content_hashes: tuple[str, str]
    only: tuple[tuple[str, ...], tuple[str, ...]]
    changed: Mapping[str, tuple[str, str]]
    joints: tuple[tuple[str, ...], tuple[str, ...]]
    rates: tuple[float, float] | None
    robots: tuple[str, str] | None
    counts: tuple[int, int]
    equal_episodes: int
    moved: int
    compared: tuple[tuple[int, int], ...]
    unmatched: tuple[tuple[int, ...], tuple[int, ...]]
    values: Mapping[str, Change]
    tasks: tuple[tuple[int, int, str, str], ...]
    frame_tasks: tuple[tuple[int, int, int, int], ...]
    provenance: Mapping[str, tuple[object, object]]

    @property
    def equal_content(self) -> bool:
        """Whether both have the same content, whatever their provenance."""
        return self.content_hashes[0] == self.content_hashes[1]

    def to_json(self) -> dict[str, object]:
        """Return the difference for JSON."""
        found = {item.name: getattr(self, item.name) for item in fields(self)}
        return {
            "equal": self.equal_content,
            **found,
            "values": {key: dict(vars(change)) for key, change in self.values.items()},
        }


def compare_datasets(
    a: Dataset, b: Dataset, come_from: tuple[Provenance | None, Provenance | None] = (None, None)
) -> Difference:
    """Compare two datasets.

    Episodes are matched by the exact values of the shared features. The others are compared in order, each with the
    next one of equal length.

    Args:
        a: One dataset.
        b: The other.
        come_from: Their provenance.
    """
    shared = [key for key in a.features if key in b.features]
    same_kind = sorted(key for key in shared if _is_comparable(a.features[key], b.features[key]))
    if same_kind == [TIME] and a.features.keys() != b.features.keys():  # equal times make no equal episodes
        same_kind = []
    hashes = [dict(enumerate(hash_episodes(d, same_kind) if same_kind else ())) for d in (a, b)]
    equal = match(hashes[0], hashes[1])
    rest = _find_unpaired_episodes(range(a.n_episodes), range(b.n_episodes), equal)
    lengths = [{episode: int(d.lengths[episode]) for episode in own} for d, own in zip((a, b), rest, strict=True)]
    compared = tuple(match(lengths[0], lengths[1])) if same_kind else ()
    matched = sorted([*equal, *compared])
    return Difference(
        content_hashes=(hash_content(a), hash_content(b)),
        only=_find_exclusive_items(tuple(a.features), tuple(b.features)),
        changed={
            key: (describe(a.features[key]), describe(b.features[key]))
            for key in shared
            if a.features[key] != b.features[key]
        },
        joints=_find_exclusive_items(_list_joints(a), _list_joints(b)),
        rates=(a.fps, b.fps) if a.fps != b.fps else None,
        robots=(a.robot_type, b.robot_type) if a.robot_type != b.robot_type else None,
        counts=(a.n_episodes, b.n_episodes),
        equal_episodes=len(equal),
        moved=sum(i != j for i, j in equal),
        compared=compared,
        unmatched=_find_unpaired_episodes(*rest, compared),
        values={key: change for key in same_kind if (change := _compare_feature(a, b, key, compared))},
        tasks=tuple((i, j, a.tasks[i], b.tasks[j]) for i, j in matched if a.tasks[i] != b.tasks[j]),
        frame_tasks=_compare_frame_tasks(a, b, matched),
        provenance=_compare_provenance(*come_from),
    )


def match(a: Mapping[int, object], b: Mapping[int, object]) -> list[tuple[int, int]]:
    """Pair the indices of equal items, each once: first those at the same index, then in order of index.

    Swapped arguments give swapped pairs.
    """
    same = [index for index, item in a.items() if index in b and b[index] == item]
    waiting: dict[object, list[int]] = {}
    for index in sorted(set(b) - set(same), reverse=True):
        waiting.setdefault(b[index], []).append(index)
    pairs = [(index, waiting[a[index]].pop()) for index in sorted(set(a) - set(same)) if waiting.get(a[index])]
    return sorted([*((index, index) for index in same), *pairs])


def describe(feature: Feature) -> str:
    """Describe a feature in words."""
    units = ", ".join(dict.fromkeys(feature.units)) or "no unit"
    return f"{feature.dtype} [{units}] {', '.join(feature.names)}"


def _is_comparable(a: Feature, b: Feature) -> bool:
    """Whether values of two features can be subtracted; a missing unit matches any."""
    return a.names == b.names and a.dtype == b.dtype and (not a.units or not b.units or a.units == b.units)


def _list_joints(dataset: Dataset) -> tuple[str, ...]:
    return list_joints(dataset.features[STATE]) if STATE in dataset.features else ()


def _find_exclusive_items(a: tuple[str, ...], b: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the items of only the first, and those of only the second."""
    return tuple(item for item in a if item not in b), tuple(item for item in b if item not in a)


def _find_unpaired_episodes(
    a: Sequence[int], b: Sequence[int], pairs: Sequence[tuple[int, int]]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the episodes of each side that are not in a pair."""
    paired = {i for i, _ in pairs}, {j for _, j in pairs}
    return tuple(i for i in a if i not in paired[0]), tuple(j for j in b if j not in paired[1])


def _compare_feature(a: Dataset, b: Dataset, key: str, pairs: Sequence[tuple[int, int]]) -> Change | None:
    """Return the difference of one feature over pairs of episodes of equal length; None if all bits agree."""
    columns = [convert_column(dataset, key) for dataset in (a, b)]
    frames, worst = 0, None
    for pair in pairs:
        one, other = (column[d.episode(i)] for column, d, i in zip(columns, (a, b), pair, strict=True))
        unequal = _view_bytes(one) != _view_bytes(other)
        if not unequal.any():
            continue
        frames += int(unequal.any(axis=1).sum())
        apart = np.abs(one.astype(np.float64) - other.astype(np.float64))
        frame, component = (int(index) for index in np.unravel_index(np.argmax(apart), apart.shape))
        if worst is None or apart[frame, component] > worst[0]:
            worst = (float(apart[frame, component]), component, pair, frame)
    if worst is None:
        return None
    feature = a.features[key] if a.features[key].units else b.features[key]
    unit = feature.units[worst[1]] if feature.units else ""
    return Change(worst[0], unit, feature.names[worst[1]], worst[2], worst[3], frames)


def _compare_frame_tasks(
    a: Dataset, b: Dataset, pairs: Sequence[tuple[int, int]]
) -> tuple[tuple[int, int, int, int], ...]:
    """Return the pairs of episodes of the same tasks in other frames, the number of these frames and the first one."""
    if a.frame_tasks is None and b.frame_tasks is None:
        return ()
    tasks, found = (a.task_of_frame, b.task_of_frame), []
    for i, j in pairs:
        unlike = np.flatnonzero(tasks[0][a.episode(i)] != tasks[1][b.episode(j)])
        if unlike.size and a.tasks[i] == b.tasks[j]:
            found.append((i, j, len(unlike), int(unlike[0])))
    return tuple(found)


def _view_bytes(values: np.ndarray) -> np.ndarray:
    """Return the bytes of each row, so that even zeros of different sign differ."""
    return np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)


def _compare_provenance(a: Provenance | None, b: Provenance | None) -> dict[str, tuple[object, object]]:
    """Return the differing entries of the provenance; None for a missing entry."""
    found = [dict(_list_entries(item)) for item in (a, b)]
    keys = dict.fromkeys([*found[0], *found[1]])
    return {key: (found[0].get(key), found[1].get(key)) for key in keys if found[0].get(key) != found[1].get(key)}


def _list_entries(provenance: Provenance | None) -> Iterator[tuple[str, object]]:
    """Yield the entries to compare; mappings are expanded to keys such as `source.effects`."""
    stored = provenance.to_json() if provenance else {}
    for key in COMPARED:
        value = stored.get(key)
        if isinstance(value, Mapping):
            yield from ((f"{key}.{name}", item) for name, item in value.items())
        elif value not in (None, "", [], False):
            yield key, value
