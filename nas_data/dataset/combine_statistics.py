"""Statistics of several episodes from the statistics of each."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np


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
