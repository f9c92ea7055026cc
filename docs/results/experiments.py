"""Make experiments.md and its pictures from the tables in `experiments`.

Run `python docs/results/experiments.py`.
"""

from functools import partial
from pathlib import Path

import numpy as np
from pages import HERE, Row, markdown_table, number, numbers, read_table, render, write_page

from nas_data.policies.intervals import ENDS, compute_median_interval, compute_share, resample_medians
from nas_data.reports.figures import Panel, draw_return_over_count, draw_returns_by_method, draw_trajectory
from nas_data.reports.style import to_png
from nas_data.studies.experiments.pipeline.authors import DIFFERENCES, RETURN_BY_COUNT, RETURNS

GIVEN = {"0.15", "0.12", "0.05", "1.745"}  # what a target or a model is made of, not a result
METHODS = {
    "expert": "the target (expert)",
    "source": "the source",
    "nas": "source + φ (NAS)",
    "forward": "ψ, with the real reward (forward)",
    "named": "source + named effects",
    "named_nas": "source + named effects + φ",
    "randomised": "the source, randomised",
}
DRAWN = ("expert", "source", "forward", "nas", "named", "named_nas", "randomised")  # from left to right
LEARNED_ON = {
    "nas": "source + φ",
    "named": "source + named effects",
    "nas_few": "source + φ, preset few",
    "nas_symmetric": "source + φ, preset symmetric",
}
FILES = {"Pusher": "pusher", "ErgoReacher": "ergo_reacher", "Striker": "striker", "ErgoShield": "ergo_shield"}
COUNTS = (10, 100, 500, 2000)
PREDICTORS = ("source + φ", "ψ", "source", "hold")
PERIODS = {"Pusher": 0.05, "ErgoShield": 0.01}  # [s] between two commands
TORQUES = {"Pusher"}  # environments whose commands are no positions
EXPLAINED = ("Pusher", "named_nas", "backlash", "")  # names leave nothing for φ: the policies are those of `named`
FIRST, ADDED, SETTLED = range(5), (5, 6, 7), (8, 9, 14, 15, 16)  # seeds of 100 against 2,000 trajectories


class Experiments:
    """What the tables say, in the words of the page."""

    def __init__(self, folder: Path) -> None:
        tables = folder / "experiments"
        self._runs = read_table(tables / "runs.csv")
        self._models = read_table(tables / "models.csv")
        self._names = read_table(tables / "names.csv")
        self._errors = read_table(tables / "errors.csv")
        self._speed = read_table(tables / "speed.csv")

    # Returns

    def _rows(self, environment: str, method: str, dynamics: str, count: int | None, variant: str) -> list[Row]:
        if (environment, method, dynamics, variant) == EXPLAINED:
            method = "named"
        asked = {
            "environment": environment,
            "method": method,
            "dynamics": dynamics,
            "variant": variant,
            "count": "" if count is None else str(count),
            "ppo": "ours",
        }
        rows = [row for row in self._runs if all(row[key] == value for key, value in asked.items())]
        return sorted(rows, key=lambda row: int(row["seed"]))

    def values(
        self,
        environment: str,
        method: str,
        column: str = "return",
        dynamics: str = "backlash",
        count: int | None = None,
        seeds: tuple[int, ...] | range | None = None,
        variant: str = "",
    ) -> np.ndarray:
        """Return a number of each seed, shape (seeds,)."""
        rows = self._rows(environment, method, dynamics, count, variant)
        return np.array([float(row[column]) for row in rows if seeds is None or int(row["seed"]) in seeds])

    def median(self, environment: str, method: str, digits: int = 1, **kind: object) -> str:
        """Return the median over seeds."""
        return number(float(np.median(self.values(environment, method, **kind))), digits)

    def mean(self, environment: str, method: str, digits: int = 1, **kind: object) -> str:
        """Return the mean over seeds."""
        return number(float(np.mean(self.values(environment, method, **kind))), digits)

    def reached(self, environment: str, method: str, dynamics: str = "backlash") -> str:
        """Return how many episodes succeed, the median over seeds."""
        return f"{100 * np.median(self.values(environment, method, 'success_rate', dynamics)):.0f} %"

    def closed(self, environment: str, method: str, dynamics: str = "backlash") -> str:
        """Return the share of the distance from source to expert that a method closes, with its interval."""
        found = compute_share(
            *(self.values(environment, name, dynamics=dynamics) for name in (method, "source", "expert"))
        )
        low, high = number(100 * found.low, 0), number(100 * found.high, 0)
        return f"{number(100 * found.value, 0)} % [{low}, {high}]"

    def closed_median(self, environment: str, method: str) -> str:
        """Return that share without its interval."""
        return self.closed(environment, method).split(" [")[0]

    def paired(self, environment: str, method: str, digits: int) -> str:
        """Return by how much a method returns more than NAS, seed by seed: median and extremes."""
        apart = self.values(environment, method) - self.values(environment, "nas")
        middle, low, high = (f"{value:+.{digits}f}".replace("-", "−") for value in (np.median(apart), *_ends(apart)))
        return f"{middle} ({low} … {high})"

    def methods_table(self, environment: str, digits: int = 1, dynamics: str = "backlash", success: bool = True) -> str:
        """Return the table of methods: returns of each seed, median, share of the distance, success."""
        rows = []
        for method, label in METHODS.items():
            values = self.values(environment, method, dynamics=dynamics)
            if not len(values):
                continue
            rates = self.values(environment, method, "success_rate", dynamics)
            closed = "" if method in ("expert", "source") else self.closed(environment, method, dynamics)
            row = [label, numbers(values, digits), number(float(np.median(values)), digits), closed]
            rows.append([*row, f"{numbers(100 * rates, 0)} %"] if success else row)
        seeds = len(self.values(environment, "expert", dynamics=dynamics))
        heads = ["learned on", f"seeds 0 … {seeds - 1}", "median", f"distance closed [bootstrap of {seeds} seeds]"]
        return markdown_table([*heads, "success"] if success else heads, rows)

    def authors(self, method: str, digits: int = 1) -> str:
        """Return the mean of the authors' returns of Pusher."""
        return number(RETURNS["pusher"][method].mean, digits)

    def authors_hits(self, method: str) -> str:
        """Return the authors' hits on the real arm, a policy each."""
        return numbers(RETURNS["ergo_shield"][method].values, 0)

    # Numbers of trajectories

    def counts_table(self) -> str:
        """Return the table of returns by number of trajectories: median, extremes and number of seeds."""
        columns = [("paper", "nas"), *(("backlash", name) for name in ("nas", "nas_few", "nas_symmetric", "named"))]
        rows = [
            [f"{count:,}", self._theirs(count)]
            + [self._spread(self.values("Pusher", method, "return", dynamics, count)) for dynamics, method in columns]
            for count in COUNTS
        ]
        heads = ["trajectories", "authors' φ, their target", "φ, `paper`", "φ", "φ, `few`", "φ, `symmetric`", "names"]
        return markdown_table(heads, rows)

    def _theirs(self, count: int) -> str:
        if count not in RETURN_BY_COUNT:
            return ""
        mean, deviation = RETURN_BY_COUNT[count]
        return f"{number(mean)} ± {number(deviation)}"

    def _spread(self, values: np.ndarray) -> str:
        if not len(values):
            return ""
        low, high = _ends(values)
        return f"{number(float(np.median(values)))} ({number(low)} … {number(high)}; {len(values)})"

    def worse(
        self, count: int, dynamics: str = "backlash", method: str = "nas", seeds: range | None = None, digits: int = 1
    ) -> str:
        """Return by how much the median of few trajectories is worse than that of 2,000 by φ's usual recipe."""
        base = method if method == "named" else "nas"
        few = self.values("Pusher", method, "return", dynamics, count, seeds)
        many = self.values("Pusher", base, "return", dynamics, 2000, seeds)
        return f"{number(100 * (np.median(few) / np.median(many) - 1), digits)} %"

    def short(self, seeds: str) -> str:
        """Return by how much 100 trajectories by `symmetric` are worse than 2,000: medians, bootstrap of the seeds."""
        sides = {"first": FIRST, "added": ADDED, "settled": SETTLED, "all": (*FIRST, *ADDED, *SETTLED)}
        few = self.values("Pusher", "nas_symmetric", count=100, seeds=sides[seeds])
        many = self.values("Pusher", "nas", count=2000, seeds=sides[seeds])
        rng = np.random.default_rng(0)
        low, high = np.quantile(resample_medians(few, rng) / resample_medians(many, rng) - 1, ENDS)
        return f"{100 * (np.median(few) / np.median(many) - 1):.1f} % [{100 * low:.1f}, {100 * high:.1f}]".replace(
            "-", "−"
        )

    # Names, predictions, time

    def named(self, environment: str, effect: str, digits: int) -> str:
        """Return what was found of an effect: one value, or the least and the largest of all joints."""
        values = [float(row["value"]) for row in self._found(environment) if row["effect"] == effect]
        low, high = number(min(values), digits), number(max(values), digits)
        return low if low == high else f"{low} to {high}"

    def named_count(self, environment: str) -> str:
        """Return how many effects were named."""
        return str(len(self._found(environment)))

    def confidence(self, environment: str) -> str:
        """Return the least and the largest confidence of an environment's names."""
        values = [float(row["confidence"]) for row in self._found(environment)]
        low, high = number(min(values), 2), number(max(values), 2)
        return low if low == high else f"{low} to {high}"

    def fell(self, environment: str) -> str:
        """Return the open-loop error before and after naming [°]."""
        row = self._found(environment)[0]
        return " → ".join(f"{np.degrees(float(row[key])):.2f}°" for key in ("before", "after"))

    def verdict(self, environment: str) -> str:
        """Return the report's verdict."""
        return self._found(environment)[0]["verdict"]

    def _found(self, environment: str) -> list[Row]:
        asked = {"environment": environment, "variant": "", "count": ""}
        rows = [row for row in self._names if all(row[key] == value for key, value in asked.items())]
        return [row for row in rows if row["effect"] != "base"]

    def errors_table(self, environment: str, episodes: str, authors: bool = False) -> str:
        """Return table 1 of an environment."""
        keys, rows = ("first_quartile", "mean", "third_quartile", "median"), []
        for row in self._errors:
            if (row["environment"], row["variant"], row["episodes"]) == (environment, "", episodes):
                cells = [row["predictor"], *(number(float(row[key]), 4) for key in keys)]
                theirs = DIFFERENCES.get(row["predictor"])
                rows.append([*cells, "" if theirs is None else numbers(theirs.values, 3)] if authors else cells)
        heads = ["squared differences of a joint [(90°)²]", "first quartile", "mean", "third quartile", "median"]
        return markdown_table([*heads, "authors: Q1, mean, Q3"] if authors else heads, rows)

    def heldout(self, environment: str, predictor: str) -> str:
        """Return the median error of held-out episodes in open loop [°]."""
        key = (environment, "", "all_heldout", predictor)
        (row,) = (r for r in self._errors if (r["environment"], r["variant"], r["episodes"], r["predictor"]) == key)
        return f"{row['median_error_deg']}°"

    def mean_error(self, environment: str, predictor: str) -> str:
        """Return the mean squared difference of an environment's episodes in the paper's protocol."""
        key = (environment, "", "paper_protocol", predictor)
        (row,) = (r for r in self._errors if (r["environment"], r["variant"], r["episodes"], r["predictor"]) == key)
        return number(float(row["mean"]), 4)

    def minutes(self, environment: str, stage: str, clock: str = "seconds") -> str:
        """Return how long a stage took [min]: `seconds` by the wall, `cpu_seconds` of processor time."""
        key = (environment, "", stage, "")
        (row,) = (
            r
            for r in self._models
            if (r["environment"], r["variant"], r["stage"], r["count"]) == key and r["dynamics"] == "backlash"
        )
        return number(float(row[clock]) / 60, 0)

    def policy_seconds(self, environment: str) -> str:
        """Return the least and the largest processor time of a policy [s]."""
        values = np.concatenate([self.values(environment, method, "cpu_seconds") for method in METHODS])
        return " to ".join(number(value, 0) for value in _ends(values))

    def commits(self, environment: str, dynamics: str = "backlash") -> str:
        """Return which commits made the policies, with their methods."""
        made: dict[str, list[str]] = {}
        for method in METHODS:
            for row in self._rows(environment, method, dynamics, None, ""):
                methods = made.setdefault(f"`{row['commit'][:7]}`", [])
                if method not in methods:
                    methods.append(method)
        return "; ".join(f"{', '.join(methods)}: {commit}" for commit, methods in made.items())

    def speed_table(self) -> str:
        """Return how fast the environment with φ is beside others."""
        compared = {
            "augmented_vs_plain_16": ("stable-baselines3's DummyVecEnv without φ", 2, "0.9"),
            "augmented_vs_naive_16": ("16 environments with a torch network each", 1, "5"),
            "augmented_vs_batched_16": ("our batched environment without φ", 2, "0.8"),
            "augmented_vs_plain_64": ("DummyVecEnv without φ, both of 64 environments", 2, "1"),
        }
        rows = []
        for key, (label, digits, bar) in compared.items():
            values = np.array([float(row[key]) for row in self._speed])
            low, high = _ends(values)
            rows.append([label, f"{np.median(values):.{digits}f}, {low:.{digits}f} … {high:.{digits}f}", bar])
        return markdown_table(
            ["16 environments with φ, compared with", "ratio: median, smallest … largest", "goal: at least"], rows
        )


def _ends(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def make_page(folder: Path) -> str:
    """Return the page that the tables of a folder make."""
    return render(folder / "experiments.md.j2", Experiments(folder))


def draw_methods(environment: str, dynamics: str = "backlash", variant: str = "") -> bytes:
    """Draw figure 5 or 8a: the return of each method's policies."""
    found = Experiments(HERE)
    values = {name: found.values(environment, name, dynamics=dynamics, variant=variant) for name in DRAWN}
    values = {name: returns for name, returns in values.items() if len(returns)}
    theirs = {name: one.values for name, one in RETURNS.get(FILES[environment], {}).items() if name in values}
    intervals = {name: compute_median_interval(returns) for name, returns in values.items()}
    label = "mean return of an episode" if environment == "ErgoShield" else "mean return on the target"
    return to_png(draw_returns_by_method([Panel(environment, values, intervals, theirs)], label, False))


def draw_counts(methods: tuple[str, ...], counts: tuple[int, ...], dynamics: str = "backlash") -> bytes:
    """Draw figure 6: the return over the number of trajectories."""
    found = Experiments(HERE)
    few = range(3) if methods != ("nas", "nas_symmetric") else None
    returns = {
        method: [found.values("Pusher", method, "return", dynamics, count, few) for count in counts]
        for method in methods
    }
    ends = {
        name: float(np.median(found.values("Pusher", name, "return", dynamics, None, range(3))))
        for name in ("expert", "source")
    }
    theirs = {} if few is None else RETURN_BY_COUNT
    return to_png(draw_return_over_count(counts, returns, LEARNED_ON, ends, theirs, False))


def draw_joint(environment: str, variant: str = "") -> bytes:
    """Draw figure 4 or 8b: one joint of a held-out episode, measured and predicted."""
    rows = [
        row
        for row in read_table(HERE / "experiments/sequences.csv")
        if (row["environment"], row["variant"]) == (environment, variant)
    ]
    column = {key: np.array([float(row[key]) for row in rows]) for key in ("measured", "command", *PREDICTORS)}
    predicted = {name: column[name] for name in PREDICTORS}
    command = None if environment in TORQUES else column["command"]
    return to_png(draw_trajectory(column["measured"], predicted, command, PERIODS[environment], rows[0]["joint"]))


PICTURES = {
    f"experiments/{name}.png": draw
    for name, draw in {
        "figure4-Pusher-backlash": partial(draw_joint, "Pusher"),
        "figure4-Pusher-heavy-backlash": partial(draw_joint, "Pusher", "heavy"),
        "figure5-Pusher-backlash": partial(draw_methods, "Pusher"),
        "figure5-Pusher-heavy-backlash": partial(draw_methods, "Pusher", variant="heavy"),
        "figure5-Pusher-paper": partial(draw_methods, "Pusher", "paper"),
        "figure5-ErgoReacher-backlash": partial(draw_methods, "ErgoReacher"),
        "figure5-Striker-backlash": partial(draw_methods, "Striker"),
        "figure6-Pusher-backlash": partial(draw_counts, ("nas",), COUNTS),
        "figure6-Pusher-backlash-named": partial(draw_counts, ("nas", "named"), (10, 100, 2000)),
        "figure6-Pusher-backlash-symmetric": partial(draw_counts, ("nas", "nas_symmetric"), COUNTS),
        "figure6-Pusher-paper": partial(draw_counts, ("nas",), COUNTS, "paper"),
        "figure8-ErgoShield-backlash": partial(draw_methods, "ErgoShield"),
        "figure8-ErgoShield-backlash-response": partial(draw_joint, "ErgoShield"),
    }.items()
}

if __name__ == "__main__":
    write_page("experiments", make_page(HERE), PICTURES)
