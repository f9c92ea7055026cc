"""Recovery of a damaged recording: its undamaged episodes become a new dataset, and the old one stays unchanged."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset import layout
from nas_data.dataset.content import has_content_hash
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.derive_provenance import Derived, make_unknown_provenance, read_attachments
from nas_data.dataset.descriptions import describe_left_out
from nas_data.dataset.episode_checks import EpisodeEntry, find_untrusted, read_episode_table
from nas_data.dataset.features import Feature
from nas_data.dataset.info import DatasetInfo
from nas_data.dataset.interrupted_video import FilmedSource
from nas_data.dataset.passthrough import PassthroughFeatures
from nas_data.dataset.provenance import Parent, Provenance, format_current_time, read_package_versions, read_provenance
from nas_data.dataset.read import Rows, find_episode_tasks, frame_tasks, read, read_tasks
from nas_data.dataset.read_damaged import ReadableRows, read_damaged_files
from nas_data.dataset.staging import MARK, find_leftovers
from nas_data.dataset.target_episodes import select_episodes
from nas_data.dataset.verify import METADATA, VerifyInput
from nas_data.dataset.versions import VERSION, find_home
from nas_data.dataset.videos import VIDEO
from nas_data.errors import DatasetInvalid, DatasetNotFound, NasError, OptionError, VideosMissing

STAGED = re.compile(rf"\.(.+){re.escape(MARK)}[0-9a-f]+")


@dataclass(frozen=True)
class Rescue:
    """Result of a recovery.

    Attributes:
        root: The damaged folder.
        derived: The dataset to write; None if nothing is damaged.
        promised: Number of episodes in its metadata; -1 if unknown.
        kept: Recovered episodes, by their old numbers.
        left: Undamaged episodes that are left out because an earlier one is lost.
        reports: What was lost or repaired, one sentence each.
    """

    root: Path
    derived: Derived | None
    promised: int
    kept: tuple[int, ...]
    left: tuple[int, ...]
    reports: tuple[str, ...]


def find_damaged(path: Path) -> Path:
    """Resolve a path to a folder: the path itself, the remains of a killed writer, or the newest version of a name.

    Raises:
        DatasetNotFound: there is no such folder.
        OptionError: there are several remains of killed writers.
        DatasetInvalid: it is being written now.
    """
    if STAGED.fullmatch(path.name) and path.is_dir() and path not in find_leftovers(path.parent):
        raise DatasetInvalid(f"{path} is being written by a running process; wait until it ends, or end it first.")
    if any((path / name).is_dir() for name in ("meta", "data")) or (path.is_dir() and STAGED.fullmatch(path.name)):
        return path
    left = find_leftovers(path) if path.is_dir() else find_leftovers(path.parent, path.name)
    if len(left) > 1:
        raise OptionError(
            f"Killed processes left several unfinished datasets there; give one of: {', '.join(map(str, left))}."
        )
    if left:
        return left[0]
    versions = [item for item in path.iterdir() if VERSION.fullmatch(item.name)] if path.is_dir() else []
    if versions:
        return max(versions, key=lambda item: int(item.name[1:].partition("-")[0]))
    reason = "neither a dataset nor an unfinished one" if path.exists() else "there is no such folder"
    raise DatasetNotFound(f"There is nothing to rescue at {path}: {reason}; give a dataset or an unfinished one.")


def find_destination(root: Path) -> tuple[Path, str]:
    """Return the folder of all datasets and the name for the recovered dataset."""
    staged = STAGED.fullmatch(root.name)
    if staged and staged.group(1) == "version":
        return root.parent.parent, root.parent.resolve().name
    return find_home(root.with_name(staged.group(1)) if staged else root)


def recover(root: Path, beyond: bool = False, like: Path | None = None) -> Rescue:
    """Collect the undamaged episodes of a damaged dataset.

    Args:
        root: Its folder.
        beyond: Also keep undamaged episodes after a lost one.
        like: A dataset with equal features, for names, units and rate if `meta/info.json` is lost.

    Raises:
        DatasetInvalid: nothing can be recovered.
    """
    info = _find_info(root, like)
    provenance, reports = _try_read_provenance(root)
    found = read_damaged_files(root, info, provenance)
    features = info.vector_features
    known = read_episode_table(root, features)
    faults = find_untrusted(found, features, known)
    whole = [episode for episode in found.episodes.tolist() if episode >= 0 and episode not in faults]
    first_gap = next((index for index, episode in enumerate(whole) if episode != index), len(whole))
    kept = whole if beyond else whole[:first_gap]
    left = [episode for episode in whole if episode not in set(kept)]
    promised = info.total_episodes if like is None else -1
    reports += [*found.files, *(f"episode {episode} {why}" for episode, why in sorted(faults.items()))]
    reports += _describe_lost_episodes(found, whole, promised)
    if not kept:
        raise DatasetInvalid(_explain_failure(root, reports, left))
    tasks = _recover_tasks(root, found, known)
    dataset = _build_dataset(info, found, kept, tasks)
    dataset = replace(dataset, frame_tasks=_recover_frame_tasks(root, found, kept))
    passthrough, left_out = _recover_passthrough(root, info, found, kept, dataset.lengths, described=like is None)
    if not reports and not left and not STAGED.fullmatch(root.name):
        if not _is_whole(root, provenance):
            reports.append("the rows are complete, but the metadata are damaged; the metadata are written again")
        elif not left_out:
            return Rescue(root, None, promised, tuple(kept), (), ())
    dataset, reports = replace(dataset, passthrough=passthrough), [*reports, *left_out]
    unknown = [episode for episode in kept if not tasks[episode]]
    if unknown:
        reports.append(f"the task of {count_of(len(unknown), 'episode')} is unknown: {_format_episode_range(unknown)}")
    derived = Derived(
        dataset, _make_provenance(root, provenance, dataset, kept, promised), read_attachments(root, provenance)
    )
    return Rescue(root, derived, promised, tuple(kept), tuple(left), tuple(reports))


def _find_info(root: Path, like: Path | None) -> DatasetInfo:
    """Return the description of the rows: `meta/info.json`, or that of a similar dataset."""
    if like is not None:
        return DatasetInfo.read(like)
    if not layout.list_data_files(root):
        raise DatasetInvalid(f"Nothing can be rescued from {root}: it holds no rows (data/*/*.parquet).")
    try:
        layout.read_json(root / layout.INFO)
    except DatasetInvalid:
        raise DatasetInvalid(
            f"{root / layout.INFO} is missing or damaged, so the names, units and rate of the rows are not known; "
            "give a dataset with the same names, units and rate: --like DATASET."
        ) from None
    return DatasetInfo.read(root)


def _try_read_provenance(root: Path) -> tuple[Provenance | None, list[str]]:
    """Return the provenance if it is readable, and remarks."""
    try:
        return read_provenance(root), []
    except DatasetInvalid:
        return None, [f"{layout.PROVENANCE} is damaged: the origin of the dataset is lost"]


def _describe_lost_episodes(found: ReadableRows, whole: Sequence[int], promised: int) -> list[str]:
    """Return sentences on episodes without rows, and on episodes missing from the metadata."""
    reports = []
    present = found.episodes[found.episodes >= 0].tolist()
    missing = max(promised, max(whole, default=-1) + 1) - len(present)
    if missing > 0:
        first = next((index for index, episode in enumerate(present) if episode != index), len(present))
        reports.append(f"the rows of {count_of(missing, 'episode')} are missing, first those of episode {first}")
    surplus = [episode for episode in whole if episode >= promised >= 0]
    if surplus:
        reports.append(
            f"it contains {count_of(len(surplus), 'episode')} that meta/info.json does not count: "
            f"{_format_episode_range(surplus)}"
        )
    return reports


def _format_episode_range(episodes: Sequence[int]) -> str:
    return f"{episodes[0]}" if len(episodes) == 1 else f"{episodes[0]} … {episodes[-1]}"


def _explain_failure(root: Path, reports: Sequence[str], left: Sequence[int]) -> str:
    reasons = "; ".join(reports) or "it holds no rows (data/*/*.parquet)"
    if left:
        return (
            f"The first episode of {root} is lost ({reasons}); {count_of(len(left), 'complete episode')} after it can "
            "be rescued: add --beyond, which gives new numbers."
        )
    return f"Nothing can be rescued from {root}: {reasons}."


def _is_whole(root: Path, provenance: Provenance | None) -> bool:
    """Whether a dataset is readable and its metadata agree with its rows."""
    if not (root / layout.TASKS).is_file():
        return False
    automatic = {key: Feature((key,), dtype=dtype) for key, dtype in layout.AUTOMATIC.items()}
    try:
        rows = Rows.read(root, automatic)
        rows.sort(root)
        evidence = VerifyInput(root, read(root), rows, provenance)
        return not any(problem for check in METADATA for problem in check(evidence))
    except NasError:
        return False


def _build_dataset(info: DatasetInfo, found: ReadableRows, kept: Sequence[int], tasks: Mapping[int, str]) -> Dataset:
    """Return the recovered episodes."""
    places = np.flatnonzero(np.isin(found.episodes, kept))
    rows = np.flatnonzero(np.isin(found.row_episodes(), places))
    features = info.vector_features
    return Dataset(
        features=features,
        columns={key: found.columns[key][rows] for key in features},
        lengths=found.lengths[places],
        fps=info.fps,
        robot_type=info.robot_type or "unknown",
        tasks=tuple(tasks[episode] for episode in kept),
    )


def _recover_passthrough(
    root: Path, info: DatasetInfo, found: ReadableRows, kept: Sequence[int], lengths: np.ndarray, described: bool
) -> tuple[PassthroughFeatures | None, list[str]]:
    """Return the pass-through features of the recovered episodes, or the reason why they are left out."""
    keys = info.other_features
    reason, located = f"{layout.INFO} is lost", False
    if described:
        try:
            return PassthroughFeatures.rescued(root, kept, lengths), []
        except DatasetInvalid as error:
            reason, located = _strip_remedy(error), isinstance(error, VideosMissing)
    if described and not located and {info.features[key].get("dtype") for key in keys} == {VIDEO}:
        try:
            filmed = FilmedSource(root, found.episodes, found.lengths, info.fps)
            return PassthroughFeatures.rescued(root, kept, lengths, filmed), []
        except DatasetInvalid as error:
            reason = _strip_remedy(error)
    if not keys:
        return None, []
    lost = describe_left_out({key: info.features[key] for key in keys}, reason)
    remains = f"what remains of it is in {root / 'videos'} and {root / 'data'}"
    return None, [f"{lost}; {remains}; if you have a copy of what is missing or damaged, put it back and recover again"]


def _strip_remedy(error: DatasetInvalid) -> str:
    """Return an error message without its remedy."""
    return str(error).partition(";")[0].rstrip(".")


def _recover_tasks(root: Path, found: ReadableRows, known: Mapping[int, EpisodeEntry]) -> dict[int, str]:
    """Return the task of each episode, from the task table or else from the episode table."""
    try:
        names = read_tasks(root)
    except DatasetInvalid:
        names = {}
    tasks = find_episode_tasks(names, found.columns["task_index"][:, 0], found.lengths)
    return {
        episode: task or ("; ".join(known[episode].tasks) if episode in known else "")
        for episode, task in zip(found.episodes.tolist(), tasks, strict=True)
    }


def _recover_frame_tasks(root: Path, found: ReadableRows, kept: Sequence[int]) -> np.ndarray | None:
    """Return each recovered frame's task, shape (N,); None if episodes have one task each, or the table is lost."""
    try:
        names = read_tasks(root)
    except DatasetInvalid:
        return None
    places = np.flatnonzero(np.isin(found.episodes, kept))
    numbers = found.columns["task_index"][np.isin(found.row_episodes(), places), 0]
    return frame_tasks(names, numbers, found.lengths[places]) if set(numbers.tolist()) <= names.keys() else None


def _make_provenance(
    root: Path, before: Provenance | None, dataset: Dataset, kept: Sequence[int], promised: int
) -> Provenance:
    """Return the provenance of the recovered dataset: that of the damaged one, which becomes its parent."""
    if before is not None and STAGED.fullmatch(root.name) and has_content_hash(dataset, before.content_hash):
        return before  # complete, killed just before it got its name
    home = root.resolve()
    name = f"{home.parent.name}/{home.name}" if VERSION.fullmatch(home.name) else find_destination(root)[1]
    deed = f"rescued from {name}: {count_of(len(kept), 'episode')}, {_format_episode_range(kept)}"
    known = before or make_unknown_provenance(dataset)
    return replace(
        known,
        target=select_episodes(known.target, kept, promised),
        how="edited",
        when=format_current_time(),
        packages=dict(read_package_versions()),
        parents=(Parent(name, before.content_hash),) if before else (),
        notes="\n".join(filter(None, [known.notes, deed])),
        files={},
    )
