"""How far 100 trajectories of Pusher on `backlash`, preset `symmetric`, fall short of 2,000: from the committed runs.

    python docs/results/hundred.py

Of the seeds 0 to 4, which were run first, of 5 to 7, which were added, and of all; the interval resamples the seeds.
"""

import json
from pathlib import Path

import numpy as np

from nas_data.policies.intervals import ENDS, resampled_medians

RUNS = Path(__file__).parent / "experiments"
MANY, FIRST = 2000, 5


def main() -> None:
    """Print both sides' returns and what one is short of the other."""
    alone = [run["policy"]["score"]["return"] for run in read("-symmetric")["runs"].values()]
    more = read("-three-more-seeds")["runs"]
    few = np.array(alone + added(more, "nas_symmetric-100"))
    many = np.array(of_many("") + of_many("-more-seeds") + added(more, f"nas-{MANY}"))
    print("  100:", few.round(2), f"standard deviation {few.std(ddof=1):.2f}")
    print(f"{MANY}:", many.round(2), f"standard deviation {many.std(ddof=1):.2f}")
    for name, rows in (
        ("seeds 0 to 4", slice(FIRST)),
        ("seeds 5 to 7", slice(FIRST, None)),
        ("all", slice(None)),
    ):
        print(f"{name}: {short(few[rows], many[rows])}")


def read(end: str) -> dict:
    """Return the results of a run of figure 6 on `backlash`."""
    return json.loads((RUNS / f"figure6-Pusher-backlash{end}.json").read_text(encoding="utf-8"))


def of_many(end: str) -> list[float]:
    """Return the returns with 2,000 trajectories, one a seed."""
    found = read(end)
    return found["methods"]["nas"]["returns"][found["counts"].index(MANY)]


def added(runs: dict, start: str) -> list[float]:
    """Return the returns of the added seeds in their order."""
    return [run["policy"]["score"]["return"] for name, run in runs.items() if name.startswith(start)]


def short(few: np.ndarray, many: np.ndarray) -> str:
    """Say by how much few trajectories fall short of many: medians with the bootstrap of the seeds, and means."""
    rng = np.random.default_rng(0)
    low, high = np.quantile(resampled_medians(few, rng) / resampled_medians(many, rng) - 1, ENDS)
    medians, means = np.median(few) / np.median(many) - 1, few.mean() / many.mean() - 1
    return f"medians {medians:.1%} [{low:.1%}, {high:.1%}], means {means:.1%}"


if __name__ == "__main__":
    main()
