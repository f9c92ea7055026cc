"""Checks of a damaged dataset's episodes: complete, finite, and consistent with the stored statistics."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset import layout
from nas_data.dataset.checks import LARGEST
from nas_data.dataset.features import Feature
from nas_data.dataset.parquet import read_parquet
from nas_data.dataset.read_damaged import ReadableRows
from nas_data.errors import DatasetInvalid

TOLERANCE = 1e-4  # relative; LeRobot's statistics pass through float32
CHECKED = ("min", "max", "mean")  # statistics that both LeRobot versions and nas compute identically


@dataclass(frozen=True)
class EpisodeEntry:
    """Entry of an episode in `meta/episodes`.

    Attributes:
        length: Number of frames.
        tasks: Its tasks.
        statistics: `<feature>/<statistic>` → values.
    """

    length: int
    tasks: tuple[str, ...]
    statistics: Mapping[str, np.ndarray]


def find_untrusted(
    found: ReadableRows, features: Mapping[str, Feature], known: Mapping[int, EpisodeEntry]
) -> dict[int, str]:
    """Return the episodes that fail a check, with the reason.

    Args:
        found: The readable rows.
        features: Features of the dataset.
        known: The readable entries of `meta/episodes`.
    """
    return dict(
        [*_find_wrong_values(found, known), *_find_wrong_rows(found, features), *_find_wrong_lengths(found, known)]
    )


def read_episode_table(root: Path, features: Mapping[str, Feature]) -> dict[int, EpisodeEntry]:
    """Return the readable entries of `meta/episodes`, by episode."""
    checked = [f"{key}/{name}" for key in features for name in CHECKED]
    found = {}
    for path in layout.list_episode_files(root):
        try:
            rows = read_parquet(path).to_pylist()
        except (DatasetInvalid, UnicodeDecodeError):
            continue
        for row in rows:
            episode, length = row.get("episode_index"), row.get("length")
            if episode is None or length is None:
                continue
            stored = {key: row.get(f"stats/{key}") for key in checked}
            found[int(episode)] = EpisodeEntry(
                length=int(length),
                tasks=tuple(sorted(map(str, row.get("tasks") or ()))),
                statistics={key: np.ravel(np.asarray(value, np.float64)) for key, value in stored.items() if value},
            )
    return found


def _find_wrong_rows(found: ReadableRows, features: Mapping[str, Feature]) -> Iterator[tuple[int, str]]:
    """Find episodes with missing or repeated frames, or with values that are not finite."""
    episode_of = found.row_episodes()
    starts = np.cumsum(found.lengths) - found.lengths
    due = np.arange(len(episode_of)) - starts[episode_of]
    torn = found.columns["frame_index"][:, 0] != due
    for episode in found.episodes[np.unique(episode_of[torn])].tolist():
        yield episode, "has missing or repeated frames"
    for key in features:
        column = found.columns[key]
        if column.dtype.kind == "f":
            wild = ~(np.abs(column.astype(np.float64)) <= LARGEST).all(axis=1)
            for episode in found.episodes[np.unique(episode_of[wild])].tolist():
                yield episode, f"has values of '{key}' that are not finite"


def _find_wrong_lengths(found: ReadableRows, known: Mapping[int, EpisodeEntry]) -> Iterator[tuple[int, str]]:
    """Find episodes whose number of frames differs from `meta/episodes`."""
    for episode, length in zip(found.episodes.tolist(), found.lengths.tolist(), strict=True):
        if episode in known and known[episode].length != length:
            yield episode, f"has {count_of(length, 'frame')}, but meta/episodes lists {known[episode].length}"


def _find_wrong_values(found: ReadableRows, known: Mapping[int, EpisodeEntry]) -> Iterator[tuple[int, str]]:
    """Find episodes whose values contradict the statistics in `meta/episodes`."""
    starts = np.cumsum(found.lengths) - found.lengths
    for key, column in found.columns.items():
        if key in layout.AUTOMATIC or not len(column):
            continue
        exact = column.astype(np.float64)
        measured = {
            "min": np.minimum.reduceat(exact, starts),
            "max": np.maximum.reduceat(exact, starts),
            "mean": np.add.reduceat(exact, starts) / found.lengths[:, None],
        }
        for row, episode in enumerate(found.episodes.tolist()):
            if episode in known and not _is_consistent(key, known[episode].statistics, measured, row):
                yield episode, f"has values of '{key}' that do not match its stored statistics"


def _is_consistent(key: str, recorded: Mapping[str, np.ndarray], measured: Mapping[str, np.ndarray], row: int) -> bool:
    """Whether the recorded statistics of a feature in an episode agree with the measured ones."""
    scale = np.maximum(np.abs(measured["min"][row]), np.abs(measured["max"][row]))
    for name, values in measured.items():
        stored = recorded.get(f"{key}/{name}")
        if stored is None or stored.shape != values[row].shape:
            continue
        if not (np.abs(stored - values[row]) <= TOLERANCE * scale).all():  # a negated comparison, so that NaN fails
            return False
    return True
