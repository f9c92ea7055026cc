"""How far 100 trajectories of Pusher on `backlash`, preset `symmetric`, fall short of 2,000: from the committed runs.

    python docs/results/hundred.py

Of the seeds 0 to 4, which were run first, of 5 to 7, which were added, of 8, 9 and 14 to 16, which were settled on
before they were run, and of all; the interval resamples the seeds. It also draws all counts that were run of both ways
to train φ, `experiments/figure6-Pusher-backlash-symmetric.png`.
"""

import json
from pathlib import Path

import numpy as np

from nas_data.experiments.pipeline.counting import LEARNED_ON
from nas_data.policies.intervals import ENDS, resampled_medians
from nas_data.reports.experiment_figures import return_over_count
from nas_data.reports.style import to_png

RUNS = Path(__file__).parent / "experiments"
FEW, MANY = 100, 2000
COUNTS = (10, FEW, 500, MANY)
NAS, SYMMETRIC = "nas", "nas_symmetric"
ADDED = {"-three-more-seeds": "seeds 5 to 7", "-five-more-seeds": "seeds 8, 9, 14 to 16"}
CURVE = "-symmetric-counts"


def main() -> None:
    """Print both sides' returns and what one is short of the other, and draw them among the other counts."""
    sides = {"seeds 0 to 4": (of_runs("-symmetric", ""), of_table(MANY))}
    for end, name in ADDED.items():
        sides[name] = of_runs(end, f"{SYMMETRIC}-{FEW}-"), of_runs(end, f"{NAS}-{MANY}-")
    few, many = (np.concatenate(side) for side in zip(*sides.values(), strict=True))
    for count, returns in ((FEW, few), (MANY, many)):
        print(f"{count:4}: {returns.round(2)} standard deviation {returns.std(ddof=1):.2f}")
    for name, (one, other) in {**sides, f"all {len(few)}": (few, many)}.items():
        print(f"{name}: {short(one, other)}")
    draw(few, many)


def read(end: str) -> dict:
    """Return the results of a run of figure 6 on `backlash`."""
    return json.loads((RUNS / f"figure6-Pusher-backlash{end}.json").read_text(encoding="utf-8"))


def of_table(count: int) -> np.ndarray:
    """Return the first five seeds' returns by the recipe for many, or those of them that were run with this count."""
    tables = [table for end in ("", "-more-seeds") if count in (table := read(end))["counts"]]
    return np.concatenate([table["methods"][NAS]["returns"][table["counts"].index(count)] for table in tables])


def of_runs(end: str, start: str) -> np.ndarray:
    """Return the returns of what was run seed by seed, in its order: of the runs whose names begin with `start`."""
    runs = read(end)["runs"].items()
    return np.array([run["policy"]["score"]["return"] for name, run in runs if name.startswith(start)])


def short(few: np.ndarray, many: np.ndarray) -> str:
    """Say by how much few trajectories fall short of many: medians with the bootstrap of the seeds, and means."""
    rng = np.random.default_rng(0)
    low, high = np.quantile(resampled_medians(few, rng) / resampled_medians(many, rng) - 1, ENDS)
    medians, means = np.median(few) / np.median(many) - 1, few.mean() / many.mean() - 1
    return f"medians {medians:.1%} [{low:.1%}, {high:.1%}], means {means:.1%}"


def draw(few: np.ndarray, many: np.ndarray) -> None:
    """Draw the returns of all counts; `few`, by the preset, and `many`, by the recipe for many, are of all seeds."""
    ends = {name: end["return"]["median"] for name, end in read("")["ends"]["methods"].items()}
    returns = {
        NAS: [*(of_table(count) for count in COUNTS[:-1]), many],
        SYMMETRIC: [few if count == FEW else of_runs(CURVE, f"{SYMMETRIC}-{count}-") for count in COUNTS],
    }
    print({method: [len(values) for values in rows] for method, rows in returns.items()}, "seeds in the picture")
    picture = return_over_count(COUNTS, returns, LEARNED_ON, ends, {}, False)
    (RUNS / "figure6-Pusher-backlash-symmetric.png").write_bytes(to_png(picture))


if __name__ == "__main__":
    main()
