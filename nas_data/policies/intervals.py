"""Uncertainty of a median over seeds: the range for few seeds, a 95 % bootstrap interval for more."""

from dataclasses import dataclass

import numpy as np

from nas_data.count_of import count_of

LEVEL = 0.95  # of intervals by resampling
ENDS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
RESAMPLES = 10_000  # of the bootstrap
MAX_RANGE_VALUES = 5  # largest number of values for which the bootstrap interval of a median is just their range


@dataclass(frozen=True)
class Interval:
    """Interval of the median over seeds.

    Attributes:
        low: Lower end.
        high: Upper end.
        seeds: Number of values.
    """

    low: float
    high: float
    seeds: int

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
