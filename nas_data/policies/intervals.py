"""Uncertainty over seeds: of a median, and of a method's share of the distance from source to expert."""

from dataclasses import dataclass

import numpy as np

from nas_data.count_of import count_of

LEVEL = 0.95  # of intervals by resampling
ENDS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
RESAMPLES = 10_000  # of the bootstrap
MAX_RANGE_VALUES = 5  # largest number of values for which the bootstrap interval of a median is just their range


@dataclass(frozen=True)
class Interval:
    """Interval of the median over seeds."""

    low: float  # lower end
    high: float  # upper end
    seeds: int  # number of values

    @property
    def level(self) -> float:
        """Coverage probability: exact for a range (binomial), nominal for a bootstrap."""
        return 1 - 2 ** (1 - self.seeds) if self.seeds <= MAX_RANGE_VALUES else LEVEL

    @property
    def kind(self) -> str:
        """Kind of interval, for a column heading."""
        return describe_interval(self.seeds)

    def describe(self) -> dict[str, object]:
        """Return the interval for JSON."""
        return {"low": self.low, "high": self.high, "kind": self.kind, "level": self.level}


def describe_interval(seeds: int) -> str:
    """Return a phrase for the interval of a median over seeds."""
    if seeds < MAX_RANGE_VALUES:
        return f"range of {count_of(seeds, 'seed')}"
    return (
        f"range of {count_of(seeds, 'seed')}, {1 - 2 ** (1 - seeds):.0%}"
        if seeds == MAX_RANGE_VALUES
        else f"bootstrap, {LEVEL:.0%}"
    )


def describe_bootstrap(seeds: int) -> str:
    """Return a phrase for a bootstrap interval over seeds; with few seeds its coverage is below its level."""
    return f"bootstrap of {count_of(seeds, 'seed')}" if seeds <= MAX_RANGE_VALUES else f"bootstrap, {LEVEL:.0%}"


def compute_median_interval(values: np.ndarray) -> Interval:
    """Return the interval of the median of values over seeds, shape (seeds,)."""
    if len(values) <= MAX_RANGE_VALUES:
        return Interval(float(values.min()), float(values.max()), len(values))
    low, high = np.quantile(resample_medians(values, np.random.default_rng(0)), ENDS)
    return Interval(float(low), float(high), len(values))


def format_median(values: np.ndarray) -> str:
    """Return the median over seeds, with its interval if there are several seeds."""
    if len(values) < 2:
        return f"{np.median(values):.2f}"
    found = compute_median_interval(values)
    return f"{np.median(values):.2f} [{found.low:.2f}, {found.high:.2f}]"


def resample_medians(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return medians of resamples with replacement, shape (RESAMPLES,)."""
    return np.median(rng.choice(values, (RESAMPLES, len(values))), axis=1)


MIN_ADVANTAGE = 1e-9  # least relative advantage of the expert for which the score is defined


@dataclass(frozen=True)
class Share:
    """Share of the difference between the source's and the expert's returns."""

    # (median of method − median of source) / (median of expert − median of source); NaN if the expert is not better
    # than the source
    value: float
    low: float  # lower end of the bootstrap interval over seeds; see `describe_bootstrap`
    high: float  # upper end
    advantage: float  # median of expert − median of source, in return
    seeds: int  # number of seeds of the method

    def __str__(self) -> str:
        """Return the share in per cent, with its interval unless all resamples are equal, as for a single seed."""
        if np.isnan(self.value):
            return "undefined"
        if self.low == self.high:
            return f"{self.value:.0%}"
        return f"{self.value:.0%} [{self.low:.0%}, {self.high:.0%}]"

    def describe(self) -> dict[str, object]:
        """Return the share for JSON."""
        interval = {"interval": [self.low, self.high], "interval_is": describe_bootstrap(self.seeds)}
        return {"value": self.value, **interval, "at_stake": self.advantage}


def compute_share(method: np.ndarray, source: np.ndarray, expert: np.ndarray) -> Share:
    """Return the score of a method between source and expert from the returns of their seeds, shape (seeds,).

    The interval resamples the seeds of all three. Resamples in which the expert is not better than the source are
    undefined and left out.
    """
    start, end = float(np.median(source)), float(np.median(expert))
    if end - start <= MIN_ADVANTAGE * max(1.0, abs(start), abs(end)):
        return Share(np.nan, np.nan, np.nan, end - start, len(method))
    rng = np.random.default_rng(0)
    starts, ends, reached = (resample_medians(values, rng) for values in (source, expert, method))
    telling = ends - starts > MIN_ADVANTAGE * np.maximum(1.0, np.maximum(abs(starts), abs(ends)))
    shares = (reached - starts)[telling] / (ends - starts)[telling]
    low, high = np.quantile(shares, ENDS)
    closed = float((np.median(method) - start) / (end - start))
    return Share(closed, float(low), float(high), end - start, len(method))


def format_share_heading(seeds: int) -> str:
    """Return the heading of a column of shares, with the kind of their intervals."""
    return f"distance closed [{describe_bootstrap(seeds)}]" if seeds > 1 else "distance closed"


@dataclass(frozen=True)
class ReturnRange:
    """Difference of the expert's and the source's returns, by medians over seeds."""

    value: float  # median of expert − median of source
    low: float  # lower end of its bootstrap interval over seeds; equal to the value for a single seed
    high: float  # upper end
    seeds: int  # number of seeds of each
    shown: bool  # whether the whole interval is above zero

    def sentence(self) -> str | None:
        """Return a sentence if expert and source score the same; None otherwise."""
        if self.shown:
            return None
        return (
            f"Source and expert do not differ significantly here (expert − source: {self.value:.2f} "
            f"[{self.low:.2f}, {self.high:.2f}], {describe_bootstrap(self.seeds)}), so the share of the distance that "
            "a method closes is undefined; make the gap larger."
        )

    def describe(self) -> dict[str, object]:
        """Return it for JSON."""
        interval = {"interval": [self.low, self.high], "interval_is": describe_bootstrap(self.seeds)}
        return {"value": self.value, **interval, "shown": self.shown}


def compute_return_range(source: np.ndarray, expert: np.ndarray) -> ReturnRange:
    """Return the difference of the expert's and the source's returns, shape (seeds,)."""
    rng = np.random.default_rng(0)
    low, high = np.quantile(resample_medians(expert, rng) - resample_medians(source, rng), ENDS)
    least = MIN_ADVANTAGE * max(1.0, float(abs(np.median(source))), float(abs(np.median(expert))))
    value = float(np.median(expert) - np.median(source))
    return ReturnRange(value, float(low), float(high), len(source), bool(low > least))
