"""LeRobot's statistics of each feature, per episode and over all: min, max, mean, std, count and five quantiles.

LeRobot estimates the quantiles of an episode from a histogram, and those of a dataset as the mean over its episodes.
Both are exact here (linear between order statistics), in the time of LeRobot's estimate for one episode.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
NAMES = ("min", "max", "mean", "std", "count", *QUANTILES)
BLOCK = 2**17  # values sorted together: half a megabyte of float32 stays in the second-level cache


@dataclass(frozen=True)
class Statistics:
    """Statistics of one feature over E episodes.

    Attributes:
        episodes: Name of the statistic → values of each episode, float64, shape (E, width); count (E, 1), int64.
        overall: Name of the statistic → values over all frames, float64, shape (width,); count (1,), int64.
    """

    episodes: Mapping[str, np.ndarray]
    overall: Mapping[str, np.ndarray]


def compute_statistics(columns: Mapping[str, np.ndarray], lengths: np.ndarray) -> dict[str, Statistics]:
    """Return the statistics of every column.

    Args:
        columns: Columns of the same N frames, shape (N, width) each.
        lengths: Frames of each episode, shape (E,), all positive.
    """
    narrow = {key: column for key, column in columns.items() if column.dtype == np.float32}
    wide = {key: column.astype(np.float64) for key, column in columns.items() if key not in narrow}
    found: dict[str, Statistics] = {}
    for group in (narrow, wide):
        if group:
            found |= _compute_group_statistics(group, lengths)
    return {key: found[key] for key in columns}


def _compute_group_statistics(columns: Mapping[str, np.ndarray], lengths: np.ndarray) -> dict[str, Statistics]:
    """Return the statistics of columns of one dtype, which are sorted side by side."""
    edges = np.cumsum([0] + [column.shape[1] for column in columns.values()])
    per_episode = _compute_episode_statistics(list(columns.values()), edges, lengths)
    counts = lengths.astype(np.int64)[:, None]
    result = {}
    for (key, column), low, high in zip(columns.items(), edges[:-1], edges[1:], strict=True):
        episodes = {name: values[:, low:high] for name, values in per_episode.items()} | {"count": counts}
        result[key] = Statistics(
            episodes={name: episodes[name] for name in NAMES}, overall=_combine_moments(column, episodes, counts)
        )
    return result


def _compute_episode_statistics(
    columns: list[np.ndarray], edges: np.ndarray, lengths: np.ndarray
) -> dict[str, np.ndarray]:
    """Return each statistic except the count, for all columns side by side, shape (E, all widths)."""
    result = {name: np.empty((len(lengths), edges[-1])) for name in NAMES if name != "count"}
    starts = np.cumsum(lengths) - lengths
    for members in _split_equal_lengths(lengths, int(edges[-1])):
        first, count, length = int(starts[members.start]), members.stop - members.start, int(lengths[members.start])
        block = np.empty((count, edges[-1], length), columns[0].dtype)
        for column, low, high in zip(columns, edges[:-1], edges[1:], strict=True):
            rows = column[first : first + count * length]
            block[:, low:high] = rows.reshape(count, length, high - low).transpose(0, 2, 1)
        block.sort(axis=-1)
        result["min"][members], result["max"][members] = block[..., 0], block[..., -1]
        for name, share in QUANTILES.items():
            result[name][members] = _compute_order_statistic(block, share)
        exact = block.astype(np.float64, copy=False)
        mean = exact.mean(axis=-1)
        result["mean"][members] = mean
        result["std"][members] = np.sqrt(np.square(exact - mean[..., None]).mean(axis=-1))
    return result


def _split_equal_lengths(lengths: np.ndarray, width: int) -> Iterator[slice]:
    """Iterate over runs of consecutive episodes of equal length, at most a block of values each."""
    breaks = np.flatnonzero(np.diff(lengths)) + 1
    for start, stop in zip([0, *breaks.tolist()], [*breaks.tolist(), len(lengths)], strict=True):
        size = max(1, BLOCK // max(1, int(lengths[start]) * width))
        for low in range(start, stop, size):
            yield slice(low, min(low + size, stop))


def _compute_order_statistic(ordered: np.ndarray, share: float) -> np.ndarray:
    """Return a quantile of values sorted along the last axis, linear between neighbours."""
    rank = share * (ordered.shape[-1] - 1)
    low = int(rank)
    below = ordered[..., low].astype(np.float64)
    above = ordered[..., min(low + 1, ordered.shape[-1] - 1)].astype(np.float64)
    return below + (rank - low) * (above - below)


def _combine_moments(
    column: np.ndarray, episodes: Mapping[str, np.ndarray], counts: np.ndarray
) -> dict[str, np.ndarray]:
    """Combine the episodes' moments (Chan's parallel formula) and sort for the quantiles."""
    total = counts.sum(axis=0)
    mean = (episodes["mean"] * counts).sum(axis=0) / total
    spread = episodes["std"] ** 2 + (episodes["mean"] - mean) ** 2
    ordered = np.sort(column.T, axis=-1)
    moments = {
        "min": episodes["min"].min(axis=0),
        "max": episodes["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt((spread * counts).sum(axis=0) / total),
        "count": total,
    }
    return moments | {name: _compute_order_statistic(ordered, share) for name, share in QUANTILES.items()}


def combine_statistics(episodes: Sequence[Mapping[str, object]]) -> dict[str, dict[str, object]]:
    """Combine the statistics of episodes as LeRobot does: exactly, except that quantiles are averaged.

    Args:
        episodes: For each episode, `stats/<feature>/<statistic>` → values.
    """
    joined: dict[str, dict[str, object]] = {}
    for key, names in _list_shared_statistics(episodes):
        values = {name: np.array([entry[f"stats/{key}/{name}"] for entry in episodes], float) for name in names}
        if not {"min", "max", "mean", "std", "count"} <= values.keys():
            continue
        count = values["count"].reshape(len(episodes), -1)[:, :1].reshape(-1, *[1] * (values["mean"].ndim - 1))
        weights = count / count.sum()
        mean = (weights * values["mean"]).sum(0)
        variance = (weights * (values["std"] ** 2 + (values["mean"] - mean) ** 2)).sum(0)
        result = {name: (weights * column).sum(0) for name, column in values.items() if name.startswith("q")}
        result |= {"min": values["min"].min(0), "max": values["max"].max(0), "mean": mean, "std": np.sqrt(variance)}
        joined[key] = {name: column.tolist() for name, column in result.items()}
        joined[key]["count"] = [int(count.sum())]
    return joined


def _list_shared_statistics(episodes: Sequence[Mapping[str, object]]) -> Iterator[tuple[str, list[str]]]:
    """Yield each feature with the names of the statistics that all episodes have."""
    shared = [key for key in episodes[0] if all(entry.get(key) is not None for entry in episodes)] if episodes else []
    keys = dict.fromkeys(name.removeprefix("stats/").rpartition("/")[0] for name in shared)
    for key in keys:
        yield key, [name.rpartition("/")[2] for name in shared if name.startswith(f"stats/{key}/")]
